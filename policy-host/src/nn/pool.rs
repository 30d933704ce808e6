//! Max pooling.

use super::maps::MapShape;

/// 3×3 max pooling with stride 2 and padding 1 of one map, for inputs that are nowhere negative: the zero border then
/// stands for the padding. The border of `output` is zero afterwards.
///
/// # Panics
/// If a slice does not have its shape.
pub fn max_pool_3x3(input: &[f32], input_shape: MapShape, output: &mut [f32], output_shape: MapShape) {
    let channels = input_shape.channels;
    assert_eq!(input.len(), input_shape.single().len(), "input {input_shape:?}");
    assert_eq!(output_shape.side, input_shape.side.div_ceil(2), "output side");
    assert_eq!((input_shape.border, output_shape.channels), (1, channels), "border and channels");
    let row_len = input_shape.pitch() * channels;
    for row in 0..output_shape.side {
        for col in 0..output_shape.side {
            let to = output_shape.offset(0, row, col);
            let pixel = &mut output[to..to + channels];
            pixel.fill(0.0);
            let corner = (2 * row * input_shape.pitch() + 2 * col) * channels;
            for kernel_row in 0..3 {
                let from = corner + kernel_row * row_len;
                for taps in input[from..from + 3 * channels].chunks_exact(channels) {
                    pixel.iter_mut().zip(taps).for_each(|(y, &x)| *y = y.max(x));
                }
            }
        }
    }
    output_shape.single().clear_border(output);
}
