//! Camera images and their preprocessor, which resizes them where needed, rounds them to bytes, scales,
//! normalises and pads them.

use std::ops::Range;

use ipc_types::ImageSize;

use crate::formats::scaling::ShiftScale;
use crate::nn::conv::feature_map::FeatureMapShape;

/// Padding of the first convolution, in pixels.
const STEM_PADDING: usize = 3;

/// A borrowed camera image `[h, w, 3] u8`, row-major, top row first.
#[derive(Clone, Copy, Debug)]
pub struct Image<'a> {
    /// RGB bytes `[h, w, 3]`.
    pub pixels: &'a [u8],
    /// Height and width.
    pub size: ImageSize,
}

/// Offset that rounds to the nearest byte, halves up. Enlarging by 7/4 produces thousands of exact halves in
/// an image; the extra 0.001 keeps rounding errors from deciding their direction.
const HALF_UP_OFFSET: f32 = 0.501;

/// Converts the images of one camera to the backbone's input.
#[derive(Clone, Debug)]
pub(crate) struct Preprocessor {
    size: ImageSize,
    /// Lookup table per channel: the normalised value of each byte.
    values: Vec<[f32; 256]>,
    /// Resizers for the other announced image sizes.
    resizers: Vec<Resizer>,
}

/// Working memory of a [`Preprocessor`].
#[derive(Clone, Debug, Default)]
pub(crate) struct ImageScratch {
    /// Horizontally resized image `[source h, target w, 3]`.
    rows: Vec<f32>,
}

impl Preprocessor {
    /// Creates a preprocessor that accepts images of `size` and `sizes`, and outputs `size`.
    pub(crate) fn new(size: ImageSize, normalisation: Option<&ShiftScale>, sizes: &[ImageSize]) -> Self {
        let value = |channel: usize, byte: usize| {
            let x = byte as f32 / 255.0;
            normalisation
                .map_or(x, |norm| (x - norm.shift[channel]) / norm.scale[channel] + norm.offset[channel])
        };
        let values = (0..3).map(|channel| std::array::from_fn(|byte| value(channel, byte))).collect();
        let others = sizes.iter().filter(|&&other| other != size);
        let resizers = others.map(|&from| Resizer::new(from, size)).collect();
        Self { size, values, resizers }
    }

    /// Returns the normalised value of each byte, per channel.
    #[cfg(feature = "gpu")]
    pub(crate) fn values(&self) -> &[[f32; 256]] {
        &self.values
    }

    /// Returns the filters with which images of size `from` are resized, the rows' before the columns'.
    /// Each takes as many words as the second result says: first source pixel, number of weights, weights.
    /// Returns `None` for images of the output's size.
    #[cfg(feature = "gpu")]
    pub(crate) fn filters(&self, from: ImageSize) -> Option<(Vec<u32>, usize)> {
        let resizer = self.resizers.iter().find(|resizer| resizer.from == from)?;
        let filters = || resizer.vertical.iter().chain(&resizer.horizontal);
        let n_words = 2 + filters().map(|taps| taps.weights.len()).max()?;
        let words = filters().flat_map(|taps| {
            let head = [taps.first as u32, taps.weights.len() as u32];
            let weights = taps.weights.iter().map(|weight| weight.to_bits());
            head.into_iter().chain(weights).chain(std::iter::repeat(0)).take(n_words)
        });
        Some((words.collect(), n_words))
    }

    /// Returns the shape of the output.
    pub(crate) fn shape(&self) -> FeatureMapShape {
        FeatureMapShape {
            batch: 1,
            height: self.size.height,
            width: self.size.width,
            channels: 3,
            padding: STEM_PADDING,
        }
    }

    /// Grows `scratch` to what images of any accepted size need.
    pub(crate) fn reserve(&self, scratch: &mut ImageScratch) {
        let max_height = self.resizers.iter().map(|resizer| resizer.from.height).max().unwrap_or(0);
        scratch.rows.resize(scratch.rows.len().max(max_height * self.size.width * 3), 0.0);
    }

    /// Resizes an image horizontally if needed. Must be called before [`run`](Self::run).
    ///
    /// # Panics
    /// If the image has the wrong number of bytes or a size that was not announced.
    pub(crate) fn prepare(&self, image: Image<'_>, scratch: &mut ImageScratch) {
        assert_eq!(image.pixels.len(), image.size.n_pixels() * 3, "image of {:?}", image.size);
        if let Some(resizer) = self.resizer(image) {
            resizer.resize_horizontally(
                image.pixels,
                &mut scratch.rows[..image.size.height * self.size.width * 3],
            );
        }
    }

    /// Computes these rows of the output, whose shape is [`shape`](Self::shape). `out` is the memory of the
    /// rows ([`FeatureMapShape::row_span`]); its padding is not written.
    pub(crate) fn run(&self, image: Image<'_>, scratch: &ImageScratch, rows: Range<usize>, out: &mut [f32]) {
        let shape = self.shape();
        let span = shape.row_span(rows.clone());
        let row_len = shape.width * 3;
        let resizer = self.resizer(image);
        for row in rows {
            let start = shape.offset(0, row, 0) - span.start;
            let out = &mut out[start..start + row_len];
            if let Some(resizer) = resizer {
                resizer.resize_row(&scratch.rows[..image.size.height * row_len], row, out);
                for pixel in out.as_chunks_mut::<3>().0 {
                    for (x, values) in pixel.iter_mut().zip(&self.values) {
                        *x = values[usize::from((*x + HALF_UP_OFFSET) as u8)];
                    }
                }
            } else {
                let bytes = image.pixels[row * row_len..][..row_len].as_chunks::<3>().0;
                for (pixel, rgb) in out.as_chunks_mut::<3>().0.iter_mut().zip(bytes) {
                    for ((x, byte), values) in pixel.iter_mut().zip(rgb).zip(&self.values) {
                        *x = values[usize::from(*byte)];
                    }
                }
            }
        }
    }

    /// Returns the resizer of an image, or `None` if it already has the output size.
    fn resizer(&self, image: Image<'_>) -> Option<&Resizer> {
        let announced = || self.resizers.iter().find(|resizer| resizer.from == image.size);
        let needs_resizing = image.size != self.size;
        needs_resizing
            .then(|| announced().unwrap_or_else(|| panic!("image size {:?} was not announced", image.size)))
    }
}

/// Bilinear resizer for images of one size, with half-pixel centres and, when downsampling, a filter widened
/// by the scale factor, like PyTorch's `interpolate(mode="bilinear", antialias=True)`.
#[derive(Clone, Debug)]
pub struct Resizer {
    from: ImageSize,
    vertical: Vec<FilterTaps>,
    horizontal: Vec<FilterTaps>,
}

/// Filter of one target pixel along one axis: the first source pixel and the weights of it and its
/// successors.
#[derive(Clone, Debug)]
struct FilterTaps {
    first: usize,
    weights: Vec<f32>,
}

impl Resizer {
    /// Creates a resizer for images of one size.
    pub fn new(from: ImageSize, to: ImageSize) -> Self {
        Self { from, vertical: taps(from.height, to.height), horizontal: taps(from.width, to.width) }
    }

    /// Resizes an image `[from height, from width, 3] u8` and rounds it to bytes, as policies do.
    pub fn resize(&self, pixels: &[u8]) -> Vec<u8> {
        let row_len = self.horizontal.len() * 3;
        let mut rows = vec![0.0; self.from.height * row_len];
        self.resize_horizontally(pixels, &mut rows);
        let mut out = vec![0.0; row_len];
        let mut bytes = Vec::with_capacity(self.vertical.len() * row_len);
        for row in 0..self.vertical.len() {
            self.resize_row(&rows, row, &mut out);
            bytes.extend(out.iter().map(|x| (x + HALF_UP_OFFSET) as u8));
        }
        bytes
    }

    /// Computes `rows [source h, target w, 3]`: every source row at the target width.
    fn resize_horizontally(&self, pixels: &[u8], rows: &mut [f32]) {
        let row_len = self.horizontal.len() * 3;
        for (bytes, row) in pixels.chunks_exact(self.from.width * 3).zip(rows.chunks_exact_mut(row_len)) {
            let bytes = bytes.as_chunks::<3>().0;
            for (pixel, taps) in row.as_chunks_mut::<3>().0.iter_mut().zip(&self.horizontal) {
                let sources = bytes[taps.first..].iter().zip(&taps.weights);
                *pixel = sources.fold([0.0; 3], |sum, (rgb, weight)| {
                    std::array::from_fn(|channel| sum[channel] + f32::from(rgb[channel]) * weight)
                });
            }
        }
    }

    /// Computes one target row `out [target w, 3]` from the horizontally resized rows.
    fn resize_row(&self, rows: &[f32], row: usize, out: &mut [f32]) {
        let taps = &self.vertical[row];
        out.fill(0.0);
        for (source, weight) in rows.chunks_exact(out.len()).skip(taps.first).zip(&taps.weights) {
            out.iter_mut().zip(source).for_each(|(y, x)| *y += x * weight);
        }
    }
}

/// Returns the filter of each target pixel along one axis: a triangle around its centre that extends at least
/// one source pixel to each side.
fn taps(n_from: usize, n_to: usize) -> Vec<FilterTaps> {
    let scale = n_from as f64 / n_to as f64;
    let radius = scale.max(1.0);
    let filter = |pixel: usize| {
        let centre = (pixel as f64 + 0.5) * scale;
        let first = (centre - radius + 0.5).max(0.0) as usize;
        let end = ((centre + radius + 0.5) as usize).min(n_from);
        let weight = |source: usize| (1.0 - ((source as f64 + 0.5 - centre) / radius).abs()).max(0.0);
        let total: f64 = (first..end).map(weight).sum();
        FilterTaps { first, weights: (first..end).map(|source| (weight(source) / total) as f32).collect() }
    };
    (0..n_to).map(filter).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Resizes an image of `side` × `side` pixels and returns the unpadded result as bytes.
    fn resized(pixels: &[u8], side: usize, height: usize, width: usize) -> Vec<u8> {
        let [size, to] = [ImageSize { height: side, width: side }, ImageSize { height, width }];
        let preprocessor = Preprocessor::new(to, None, &[size]);
        let mut scratch = ImageScratch::default();
        preprocessor.reserve(&mut scratch);
        let shape = preprocessor.shape();
        let mut out = vec![0.0; shape.len()];
        let rows = 0..shape.n_rows();
        preprocessor.prepare(Image { pixels, size }, &mut scratch);
        let memory = &mut out[shape.row_span(rows.clone())];
        preprocessor.run(Image { pixels, size }, &scratch, rows, memory);
        let inner = (0..height).flat_map(|row| {
            let start = shape.offset(0, row, 0);
            out[start..start + width * 3].iter().map(|x| (x * 255.0).round() as u8)
        });
        let bytes: Vec<u8> = inner.collect();
        if to != size {
            assert_eq!(bytes, Resizer::new(size, to).resize(pixels), "{height}×{width}");
        }
        bytes
    }

    #[test]
    fn uniform_image_stays_uniform_at_every_size() {
        for (height, width) in [(8, 8), (3, 5), (16, 8), (224, 131)] {
            assert!(resized(&[77; 8 * 8 * 3], 8, height, width).iter().all(|&x| x == 77), "{height}×{width}");
        }
    }

    #[test]
    fn halving_averages_under_triangle_filter() {
        // One bright column. The filter weights are 1/8, 3/8, 3/8, 1/8.
        let pixels: Vec<u8> = (0..8 * 8 * 3).map(|i| if i / 3 % 8 == 3 { 160 } else { 0 }).collect();
        let row: Vec<u8> = resized(&pixels, 8, 4, 4)[..12].iter().step_by(3).copied().collect();
        assert_eq!(row, [0, 60, 20, 0]);
    }

    #[test]
    fn doubling_weights_three_to_one_and_clamps() {
        let pixels: Vec<u8> = (0..4 * 4 * 3).map(|i| 40 * (i / 3 % 4) as u8).collect();
        let row: Vec<u8> = resized(&pixels, 4, 8, 8)[..24].iter().step_by(3).copied().collect();
        assert_eq!(row, [0, 10, 30, 50, 70, 90, 110, 120]);
    }
}
