// Image of one camera: bytes [n_samples, FROM_HEIGHT, FROM_WIDTH, 3], FROM_WORDS words per sample, resized to
// [HEIGHT, WIDTH], rounded to bytes, and mapped to normalised values by a table [3, 256]. The result is image
// OUT_IMAGE of the sample's OUT_IMAGES images.
override HEIGHT: u32;
override WIDTH: u32;
override FROM_WIDTH: u32;
override FROM_WORDS: u32;
override OUT_IMAGES: u32;
override OUT_IMAGE: u32;
// Words per target pixel in the filters: first source pixel, number of weights, weights.
override TAPS: u32;
// 0 if the image has the target's size.
override RESIZES: u32;
@group(0) @binding(1) var<storage, read> bytes: array<u32>;
@group(0) @binding(2) var<storage, read> table: array<f32>;
// Filters of the rows, then of the columns.
@group(0) @binding(3) var<storage, read> filters: array<u32>;
@group(0) @binding(4) var<storage, read_write> out: array<f32>;

fn byte(sample: u32, at: u32) -> u32 {
    return bytes[sample * FROM_WORDS + at / 4u] >> (8u * (at % 4u)) & 255u;
}

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixels = HEIGHT * WIDTH;
    if (id.x >= batch.n_samples * pixels) {
        return;
    }
    let sample = id.x / pixels;
    let row = id.x % pixels / WIDTH;
    let column = id.x % WIDTH;
    let start = ((sample * OUT_IMAGES + OUT_IMAGE) * pixels + id.x % pixels) * 3u;
    if (RESIZES == 0u) {
        for (var channel = 0u; channel < 3u; channel++) {
            out[start + channel] = table[channel * 256u + byte(sample, (row * WIDTH + column) * 3u + channel)];
        }
        return;
    }
    let down = row * TAPS;
    let along = (HEIGHT + column) * TAPS;
    var sum = vec3(0.0);
    for (var i = 0u; i < filters[down + 1u]; i++) {
        var pixel = vec3(0.0);
        for (var j = 0u; j < filters[along + 1u]; j++) {
            let at = ((filters[down] + i) * FROM_WIDTH + filters[along] + j) * 3u;
            let rgb = vec3(f32(byte(sample, at)), f32(byte(sample, at + 1u)), f32(byte(sample, at + 2u)));
            pixel += rgb * bitcast<f32>(filters[along + 2u + j]);
        }
        sum += pixel * bitcast<f32>(filters[down + 2u + i]);
    }
    // Rounds halves up, as the CPU does.
    let rounded = vec3<u32>(clamp(sum + 0.501, vec3(0.0), vec3(255.0)));
    for (var channel = 0u; channel < 3u; channel++) {
        out[start + channel] = table[channel * 256u + rounded[channel]];
    }
}
