// Left factor of a convolution: row i is the window of output pixel i over feature maps [images, h, w, c].
// Its entries are ordered by kernel row, kernel column and channel.
override ROWS: u32;
override K: u32;
override HEIGHT: u32;
override WIDTH: u32;
override CHANNELS: u32;
override OUT_HEIGHT: u32;
override OUT_WIDTH: u32;
override KERNEL: u32;
override STRIDE: u32;
override PADDING: u32;
@group(0) @binding(1) var<storage, read> a: array<f32>;

struct Place { image: u32, y: i32, x: i32 }

fn place(row: u32) -> Place {
    let pixel = row % (OUT_HEIGHT * OUT_WIDTH);
    let y = i32(pixel / OUT_WIDTH * STRIDE) - i32(PADDING);
    let x = i32(pixel % OUT_WIDTH * STRIDE) - i32(PADDING);
    return Place(row / (OUT_HEIGHT * OUT_WIDTH), y, x);
}

fn left(at: Place, k: u32) -> f32 {
    let tap = k / CHANNELS;
    let y = at.y + i32(tap / KERNEL);
    let x = at.x + i32(tap % KERNEL);
    if (y < 0 || x < 0 || y >= i32(HEIGHT) || x >= i32(WIDTH)) {
        return 0.0;
    }
    return a[((at.image * HEIGHT + u32(y)) * WIDTH + u32(x)) * CHANNELS + k % CHANNELS];
}

