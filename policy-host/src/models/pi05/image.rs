//! Camera images as the network's input: resized with their aspect ratio kept, centred on black, with values
//! in [−1, 1].

/// Value of black, the letterbox padding of an image.
pub const BLACK: f32 = -1.0;
/// Letterbox padding in LeRobot before 0.5: black, scaled from [0, 1] to [−1, 1] once more.
pub(crate) const BLACK_SCALED_TWICE: f32 = -3.0;

/// Inputs of one output row or column: two neighbours and the weight of the second.
#[derive(Clone, Copy, Debug)]
struct Tap {
    first: usize,
    second: usize,
    weight: f32,
}

/// Resizes a camera image `[height, width, 3] u8` of this size, `[height, width]`, to planes
/// `[3, side, side] f32`, with the weights of PyTorch's bilinear interpolation (`align_corners=False`, no
/// antialiasing). `padding_value` fills the rest of each plane.
///
/// # Panics
/// If a slice is too short.
pub fn resize_with_pad(pixels: &[u8], size: [usize; 2], side: usize, padding_value: f32, planes: &mut [f32]) {
    let ratio = (size[1] as f64 / side as f64).max(size[0] as f64 / side as f64);
    let [height, width] = size.map(|length| (length as f64 / ratio) as usize);
    let (rows, cols) = (taps(size[0], height), taps(size[1], width));
    let (top, left) = ((side - height) / 2, (side - width) / 2);
    let is_resized = [height, width] != size;
    planes.fill(padding_value);
    for (channel, plane) in planes.chunks_exact_mut(side * side).enumerate() {
        let value = |row: usize, col: usize| f32::from(pixels[(row * size[1] + col) * 3 + channel]) / 255.0;
        for (row, line) in rows.iter().zip(plane[top * side..].chunks_exact_mut(side)) {
            for (col, out) in cols.iter().zip(&mut line[left..]) {
                let mix =
                    |row| (1.0 - col.weight) * value(row, col.first) + col.weight * value(row, col.second);
                let x = if is_resized {
                    (1.0 - row.weight) * mix(row.first) + row.weight * mix(row.second)
                } else {
                    value(row.first, col.first)
                };
                *out = x.clamp(0.0, 1.0) * 2.0 - 1.0;
            }
        }
    }
}

/// Returns the taps of all output rows or columns.
fn taps(source: usize, target: usize) -> Vec<Tap> {
    let scale = source as f32 / target as f32;
    let tap = |idx: usize| {
        let centre = (scale * (idx as f32 + 0.5) - 0.5).max(0.0);
        let first = (centre as usize).min(source - 1);
        Tap { first, second: (first + 1).min(source - 1), weight: centre - first as f32 }
    };
    (0..target).map(tap).collect()
}
