//! From camera bytes to the network's input: resized and rounded to bytes where needed, scaled, normalised, bordered.

use std::ops::Range;

use super::architecture::ImageSize;
use super::normalise::Affine;
use crate::nn::maps::MapShape;

/// The padding of the first convolution.
const BORDER: usize = 3;

/// A camera's image, where it lies: `[height, width, 3] u8`, row-major, top row first.
#[derive(Clone, Copy, Debug)]
pub struct Image<'a> {
    /// Its bytes.
    pub pixels: &'a [u8],
    /// Its sides.
    pub size: ImageSize,
}

/// Rounds to the nearest byte, halves up. Enlarging by 7/4 makes thousands of exact halves in an image; the thousandth keeps
/// rounding errors from deciding about them.
const ALMOST_HALF_UP: f32 = 0.501;

/// Turns the bytes of one camera into the backbone's input.
#[derive(Clone, Debug)]
pub(super) struct Preprocessor {
    size: ImageSize,
    /// The normalised value of each byte, for each channel.
    values: Vec<[f32; 256]>,
    /// How images of other sizes become this one.
    resizers: Vec<Resizer>,
}

/// Working memory.
#[derive(Clone, Debug, Default)]
pub(super) struct ImageScratch {
    /// `[height before, width after, 3]`: rows resized, columns not yet.
    rows: Vec<f32>,
}

impl Preprocessor {
    /// For images of these sizes, which the network sees as `size`.
    pub(super) fn new(size: ImageSize, normalisation: Option<&Affine>, sizes: &[ImageSize]) -> Self {
        let value = |channel: usize, byte: usize| {
            let x = byte as f32 / 255.0;
            normalisation.map_or(x, |affine| (x - affine.shift[channel]) / affine.scale[channel])
        };
        let values = (0..3).map(|channel| std::array::from_fn(|byte| value(channel, byte))).collect();
        let others = sizes.iter().filter(|&&other| other != size);
        let resizers = others.map(|&from| Resizer::new(from, size)).collect();
        Self { size, values, resizers }
    }

    /// Shape of a normalised image.
    pub(super) fn shape(&self) -> MapShape {
        MapShape { n_maps: 1, height: self.size.height, width: self.size.width, channels: 3, border: BORDER }
    }

    /// Working memory for any of its images.
    pub(super) fn reserve(&self, scratch: &mut ImageScratch) {
        let longest = self.resizers.iter().map(|resizer| resizer.from.height).max().unwrap_or(0);
        scratch.rows.resize(scratch.rows.len().max(longest * self.size.width * 3), 0.0);
    }

    /// Resizes the rows of an image that needs it: to be called before [`run`](Self::run).
    ///
    /// # Panics
    /// If the image does not have its size, or this size was not announced.
    pub(super) fn prepare(&self, image: Image<'_>, scratch: &mut ImageScratch) {
        assert_eq!(image.pixels.len(), image.size.n_places() * 3, "image of {:?}", image.size);
        if let Some(resizer) = self.resizer(image) {
            resizer.run_rows(image.pixels, &mut scratch.rows[..image.size.height * self.size.width * 3]);
        }
    }

    /// Fills the inner pixels of these lines of a map of shape [`shape`](Self::shape): `out` is the memory of the lines
    /// ([`MapShape::lines`]), whose border is left alone.
    pub(super) fn run(&self, image: Image<'_>, scratch: &ImageScratch, lines: Range<usize>, out: &mut [f32]) {
        let shape = self.shape();
        let memory = shape.lines(lines.clone());
        let row_len = shape.width * 3;
        let resizer = self.resizer(image);
        for row in lines {
            let start = shape.offset(0, row, 0) - memory.start;
            let out = &mut out[start..start + row_len];
            if let Some(resizer) = resizer {
                resizer.mix_rows(&scratch.rows[..image.size.height * row_len], row, out);
                for pixel in out.as_chunks_mut::<3>().0 {
                    for (x, values) in pixel.iter_mut().zip(&self.values) {
                        *x = values[usize::from((*x + ALMOST_HALF_UP) as u8)];
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

    /// What resizes an image, if it has to be.
    fn resizer(&self, image: Image<'_>) -> Option<&Resizer> {
        let announced = || self.resizers.iter().find(|resizer| resizer.from == image.size);
        let other = image.size != self.size;
        other.then(|| announced().unwrap_or_else(|| panic!("no image of {:?} was announced", image.size)))
    }
}

/// Resizes images of one size bilinearly, with half-pixel centres, and with a filter as wide as the step where they
/// shrink, as PyTorch's `interpolate(mode="bilinear", antialias=True)` does.
#[derive(Clone, Debug)]
struct Resizer {
    from: ImageSize,
    down: Vec<Taps>,
    across: Vec<Taps>,
}

/// The source pixels of one target pixel along an axis: the first, and the weights of it and those after it.
#[derive(Clone, Debug)]
struct Taps {
    first: usize,
    weights: Vec<f32>,
}

impl Resizer {
    fn new(from: ImageSize, to: ImageSize) -> Self {
        Self { from, down: taps(from.height, to.height), across: taps(from.width, to.width) }
    }

    /// `rows [height before, width after, 3]`: every source row at its new width.
    fn run_rows(&self, pixels: &[u8], rows: &mut [f32]) {
        let row_len = self.across.len() * 3;
        for (bytes, row) in pixels.chunks_exact(self.from.width * 3).zip(rows.chunks_exact_mut(row_len)) {
            let bytes = bytes.as_chunks::<3>().0;
            for (pixel, taps) in row.as_chunks_mut::<3>().0.iter_mut().zip(&self.across) {
                let sources = bytes[taps.first..].iter().zip(&taps.weights);
                *pixel = sources.fold([0.0; 3], |sum, (rgb, weight)| {
                    std::array::from_fn(|channel| sum[channel] + f32::from(rgb[channel]) * weight)
                });
            }
        }
    }

    /// One target row of `rows`.
    fn mix_rows(&self, rows: &[f32], row: usize, out: &mut [f32]) {
        let taps = &self.down[row];
        out.fill(0.0);
        for (source, weight) in rows.chunks_exact(out.len()).skip(taps.first).zip(&taps.weights) {
            out.iter_mut().zip(source).for_each(|(y, x)| *y += x * weight);
        }
    }
}

/// For each target pixel along an axis: a triangle around its centre, at least one source pixel wide to each side.
fn taps(n_from: usize, n_to: usize) -> Vec<Taps> {
    let scale = n_from as f64 / n_to as f64;
    let reach = scale.max(1.0);
    let of_pixel = |pixel: usize| {
        let centre = (pixel as f64 + 0.5) * scale;
        let first = (centre - reach + 0.5).max(0.0) as usize;
        let end = ((centre + reach + 0.5) as usize).min(n_from);
        let weight = |source: usize| (1.0 - ((source as f64 + 0.5 - centre) / reach).abs()).max(0.0);
        let total: f64 = (first..end).map(weight).sum();
        Taps { first, weights: (first..end).map(|source| (weight(source) / total) as f32).collect() }
    };
    (0..n_to).map(of_pixel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The inner pixels after resizing `side`² bytes, as bytes again.
    fn resized(pixels: &[u8], side: usize, height: usize, width: usize) -> Vec<u8> {
        let size = ImageSize { height: side, width: side };
        let preprocessor = Preprocessor::new(ImageSize { height, width }, None, &[size]);
        let mut scratch = ImageScratch::default();
        preprocessor.reserve(&mut scratch);
        let shape = preprocessor.shape();
        let mut out = vec![0.0; shape.len()];
        let lines = 0..shape.n_lines();
        preprocessor.prepare(Image { pixels, size }, &mut scratch);
        let memory = &mut out[shape.lines(lines.clone())];
        preprocessor.run(Image { pixels, size }, &scratch, lines, memory);
        let inner = (0..height).flat_map(|row| {
            let start = shape.offset(0, row, 0);
            out[start..start + width * 3].iter().map(|x| (x * 255.0).round() as u8)
        });
        inner.collect()
    }

    #[test]
    fn a_uniform_image_stays_uniform_at_every_size() {
        for (height, width) in [(8, 8), (3, 5), (16, 8), (224, 131)] {
            assert!(resized(&[77; 8 * 8 * 3], 8, height, width).iter().all(|&x| x == 77), "{height}×{width}");
        }
    }

    #[test]
    fn halving_averages_under_a_triangle_two_pixels_wide() {
        // One bright column: its neighbours' weights are 1/8, 3/8, 3/8, 1/8.
        let pixels: Vec<u8> = (0..8 * 8 * 3).map(|i| if i / 3 % 8 == 3 { 160 } else { 0 }).collect();
        let row: Vec<u8> = resized(&pixels, 8, 4, 4)[..12].iter().step_by(3).copied().collect();
        assert_eq!(row, [0, 60, 20, 0]);
    }

    #[test]
    fn doubling_mixes_three_to_one_and_holds_the_edge() {
        let pixels: Vec<u8> = (0..4 * 4 * 3).map(|i| 40 * (i / 3 % 4) as u8).collect();
        let row: Vec<u8> = resized(&pixels, 4, 8, 8)[..24].iter().step_by(3).copied().collect();
        assert_eq!(row, [0, 10, 30, 50, 70, 90, 110, 120]);
    }
}
