//! Max pooling.

use std::ops::Range;

use super::maps::MapShape;

/// 3×3 max pooling with stride 2 and padding 1 into these lines of the output, for inputs that are nowhere negative: the
/// zero border then stands for the padding. `output` is the memory of the lines ([`MapShape::lines`]), whose border is left
/// alone.
///
/// # Panics
/// If a slice does not have its shape.
pub fn max_pool_3x3(
    (input, input_shape): (&[f32], MapShape),
    (output, output_shape): (&mut [f32], MapShape),
    lines: Range<usize>,
) {
    let channels = input_shape.channels;
    assert_eq!(input.len(), input_shape.len(), "input {input_shape:?}");
    let halves = [input_shape.height, input_shape.width].map(|side| side.div_ceil(2));
    assert_eq!([output_shape.height, output_shape.width], halves, "output sides");
    assert_eq!((input_shape.border, output_shape.channels), (1, channels), "border and channels");
    let memory = output_shape.lines(lines.clone());
    assert_eq!(output.len(), memory.len(), "lines {lines:?} of {output_shape:?}");
    let row_len = input_shape.pitch() * channels;
    for line in lines {
        let (map_idx, row) = (line / output_shape.height, line % output_shape.height);
        let map = &input[map_idx * input_shape.map_len()..];
        for col in 0..output_shape.width {
            let to = output_shape.offset(map_idx, row, col) - memory.start;
            let pixel = &mut output[to..to + channels];
            pixel.fill(0.0);
            let corner = (2 * row * input_shape.pitch() + 2 * col) * channels;
            for kernel_row in 0..3 {
                let from = corner + kernel_row * row_len;
                for taps in map[from..from + 3 * channels].chunks_exact(channels) {
                    pixel.iter_mut().zip(taps).for_each(|(y, &x)| *y = y.max(x));
                }
            }
        }
    }
}
