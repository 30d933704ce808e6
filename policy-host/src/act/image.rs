//! From camera bytes to the network's input: resized to 224×224 where needed, scaled, normalised, bordered.

use ipc_types::layout::{EXTERNAL_SIDE, HAND_SIDE};

use super::config::ActConfig;
use crate::nn::maps::MapShape;

/// ImageNet's channel means and standard deviations (spec/eval.md §1.2).
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const STD: [f32; 3] = [0.229, 0.224, 0.225];

/// The padding of the first convolution.
const BORDER: usize = 3;

/// Shape of a normalised image.
pub const IMAGE_SHAPE: MapShape =
    MapShape { n_maps: 1, side: ActConfig::IMAGE_SIDE, channels: 3, border: BORDER };

/// A camera's image, where it lies: `[side, side, 3] u8`, row-major, top row first.
#[derive(Clone, Copy, Debug)]
pub enum Image<'a> {
    /// 224×224.
    External(&'a [u8]),
    /// 128×128, resized to 224×224.
    Hand(&'a [u8]),
}

/// Turns bytes into the backbone's input.
#[derive(Clone, Debug)]
pub struct Preprocessor {
    /// The normalised value of each byte, for each channel.
    values: [[f32; 256]; 3],
    /// For each pixel of the larger side: the lower source pixel, the upper one, and the weight of the upper.
    taps: Vec<(usize, usize, f32)>,
}

impl Default for Preprocessor {
    fn default() -> Self {
        let value = |channel: usize, byte: usize| (byte as f32 / 255.0 - MEAN[channel]) / STD[channel];
        let values = [0, 1, 2].map(|channel| std::array::from_fn(|byte| value(channel, byte)));
        let scale = HAND_SIDE as f32 / EXTERNAL_SIDE as f32;
        let taps = (0..EXTERNAL_SIDE).map(|pixel| {
            let place = ((pixel as f32 + 0.5) * scale - 0.5).clamp(0.0, (HAND_SIDE - 1) as f32);
            let low = place as usize;
            (low, (low + 1).min(HAND_SIDE - 1), place - low as f32)
        });
        Self { values, taps: taps.collect() }
    }
}

impl Preprocessor {
    /// Fills the inner pixels of `out`, of shape [`IMAGE_SHAPE`]; its border is left alone.
    ///
    /// A small image is enlarged bilinearly with half-pixel centres and rounded to bytes, as the reference does (its
    /// anti-aliasing changes nothing when an image grows).
    ///
    /// # Panics
    /// If a slice does not have its size.
    pub fn run(&self, image: Image<'_>, out: &mut [f32]) {
        assert_eq!(out.len(), IMAGE_SHAPE.len(), "normalised image");
        let row_len = EXTERNAL_SIDE * 3;
        let mut bytes = [0; EXTERNAL_SIDE * 3];
        for row in 0..EXTERNAL_SIDE {
            let bytes: &[u8] = match image {
                Image::External(pixels) => {
                    assert_eq!(pixels.len(), EXTERNAL_SIDE * row_len, "external image");
                    &pixels[row * row_len..(row + 1) * row_len]
                }
                Image::Hand(pixels) => {
                    self.enlarged_row(pixels, row, &mut bytes);
                    &bytes
                }
            };
            let first = IMAGE_SHAPE.offset(0, row, 0);
            let pixels = out[first..first + row_len].as_chunks_mut::<3>().0.iter_mut();
            for (pixel, rgb) in pixels.zip(bytes.as_chunks::<3>().0) {
                *pixel = std::array::from_fn(|channel| self.values[channel][usize::from(rgb[channel])]);
            }
        }
    }

    fn enlarged_row(&self, pixels: &[u8], row: usize, out: &mut [u8]) {
        assert_eq!(pixels.len(), HAND_SIDE * HAND_SIDE * 3, "hand image");
        let (low, high, weight) = self.taps[row];
        let source = |row: usize| pixels[row * HAND_SIDE * 3..(row + 1) * HAND_SIDE * 3].as_chunks::<3>().0;
        let (upper, lower) = (source(low), source(high));
        for (rgb, &(left, right, across)) in out.as_chunks_mut::<3>().0.iter_mut().zip(&self.taps) {
            *rgb = std::array::from_fn(|channel| {
                let mix = |row: &[[u8; 3]]| {
                    let (left, right) = (f32::from(row[left][channel]), f32::from(row[right][channel]));
                    left * (1.0 - across) + right * across
                };
                (mix(upper) * (1.0 - weight) + mix(lower) * weight).round_ties_even() as u8
            });
        }
    }
}
