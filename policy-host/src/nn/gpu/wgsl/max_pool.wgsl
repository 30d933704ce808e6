// Maximum over windows of 3 × 3 pixels with stride 2 and padding 1, of feature maps
// [images, HEIGHT, WIDTH, CHANNELS].
override ITEMS: u32;
override HEIGHT: u32;
override WIDTH: u32;
override CHANNELS: u32;
@group(0) @binding(1) var<storage, read> a: array<f32>;
@group(0) @binding(2) var<storage, read_write> out: array<f32>;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= batch.n_samples * ITEMS) {
        return;
    }
    let out_width = (WIDTH + 1u) / 2u;
    let out_height = (HEIGHT + 1u) / 2u;
    let channel = id.x % CHANNELS;
    let pixel = id.x / CHANNELS;
    let x = i32(pixel % out_width * 2u) - 1;
    let y = i32(pixel / out_width % out_height * 2u) - 1;
    let image = pixel / out_width / out_height;
    var largest = -3e38;
    for (var i = max(y, 0); i < min(y + 3, i32(HEIGHT)); i++) {
        for (var j = max(x, 0); j < min(x + 3, i32(WIDTH)); j++) {
            let value = a[((image * HEIGHT + u32(i)) * WIDTH + u32(j)) * CHANNELS + channel];
            // NaN stays.
            if (value > largest || value != value) {
                largest = value;
            }
        }
    }
    out[id.x] = largest;
}
