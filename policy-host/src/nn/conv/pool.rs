//! Max pooling.

use std::ops::Range;

use super::feature_map::FeatureMapShape;

/// Computes these rows of a 3×3 max pooling with stride 2 and padding 1. The input must be non-negative, so
/// that the zero padding in memory has no effect. `output` is the memory of the rows
/// ([`FeatureMapShape::row_span`]); its padding is not written.
///
/// # Panics
/// If a slice does not have its shape.
pub fn max_pool2d_3x3(
    (input, input_shape): (&[f32], FeatureMapShape),
    (output, output_shape): (&mut [f32], FeatureMapShape),
    rows: Range<usize>,
) {
    let channels = input_shape.channels;
    assert_eq!(input.len(), input_shape.len(), "input {input_shape:?}");
    let halved = [input_shape.height, input_shape.width].map(|side| side.div_ceil(2));
    assert_eq!([output_shape.height, output_shape.width], halved, "output height and width");
    assert_eq!((input_shape.padding, output_shape.channels), (1, channels), "padding and channels");
    let span = output_shape.row_span(rows.clone());
    assert_eq!(output.len(), span.len(), "rows {rows:?} of {output_shape:?}");
    let row_len = input_shape.padded_width() * channels;
    for out_row in rows {
        let (image_idx, row) = (out_row / output_shape.height, out_row % output_shape.height);
        let image = &input[image_idx * input_shape.image_len()..];
        for col in 0..output_shape.width {
            let to = output_shape.offset(image_idx, row, col) - span.start;
            let pixel = &mut output[to..to + channels];
            pixel.fill(0.0);
            let corner = (2 * row * input_shape.padded_width() + 2 * col) * channels;
            for kernel_row in 0..3 {
                let from = corner + kernel_row * row_len;
                for taps in image[from..from + 3 * channels].chunks_exact(channels) {
                    let larger = |y: f32, x: f32| if x > y || x.is_nan() { x } else { y };
                    pixel.iter_mut().zip(taps).for_each(|(y, &x)| *y = larger(*y, x));
                }
            }
        }
    }
}
