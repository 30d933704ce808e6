//! GIF encoder. A frame whose changed pixels have at most 255 colours gets an exact palette. Other frames are
//! dithered to a fixed colour cube by a threshold matrix that is fixed to the image, so that static regions
//! do not flicker.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};

use gif::{Encoder, EncodingError, Extension, Frame, Repeat};

use super::STEPS_PER_S;
use crate::show::MARK;
use crate::show::contact_sheet::RgbImage;

/// Levels of red, green and blue in the colour cube. Green gets the most because the eye is most sensitive to
/// it.
const LEVELS: [usize; 3] = [6, 7, 6];
/// Palette index of unchanged, transparent pixels. The colours of a palette follow it.
const UNCHANGED: u8 = 0;
/// Maximum number of colours in a palette, next to [`UNCHANGED`].
const MAX_COLORS: usize = 255;
/// Thresholds of an 8 × 8 ordered dither, in 1/64 (Bayer, "An optimum method for two-level rendition of
/// continuous-tone pictures", ICC 1973).
const BAYER: [[usize; 8]; 8] = bayer();

/// A GIF file that is being written.
pub(crate) struct Gif {
    encoder: Encoder<BufWriter<File>>,
    /// Duration of a frame, in 1/100 s.
    delay: u16,
}

impl Gif {
    /// Writes the header and the first frame.
    pub(crate) fn begin(
        file: BufWriter<File>,
        steps_per_frame: u16,
        first: &RgbImage,
    ) -> Result<Self, EncodingError> {
        let [width, height] = first.size().map(|px| px as u16);
        let mut encoder = Encoder::new(file, width, height, &cube())?;
        encoder.set_repeat(Repeat::Infinite)?;
        encoder.write_raw_extension(Extension::Comment.into(), &[MARK.as_bytes()])?;
        let delay = 100 * steps_per_frame / STEPS_PER_S;
        encoder.write_frame(&encoded(first, delay, |_| true))?;
        Ok(Self { encoder, delay })
    }

    /// Writes the pixels of `frame` that differ from the `previous` frame; all others are transparent.
    pub(crate) fn push(&mut self, frame: &RgbImage, previous: &RgbImage) -> Result<(), EncodingError> {
        let changed: Vec<bool> =
            frame.pixels().zip(previous.pixels()).map(|(now, previous)| now != previous).collect();
        self.encoder.write_frame(&encoded(frame, self.delay, |pixel| changed[pixel]))
    }

    /// Writes the trailer and flushes the file.
    pub(crate) fn finish(self) -> Result<(), EncodingError> {
        Ok(self.encoder.into_inner()?.flush()?)
    }
}

/// Encodes the pixels for which `changed` returns `true`; all others are transparent.
fn encoded(image: &RgbImage, delay: u16, changed: impl Fn(usize) -> bool) -> Frame<'static> {
    let [width, height] = image.size();
    let exact = exact_palette(image, &changed);
    let index = |(pixel, rgb): (usize, [u8; 3])| match &exact {
        _ if !changed(pixel) => UNCHANGED,
        Some(indices) => indices[&rgb],
        None => dithered(rgb, BAYER[pixel / width % 8][pixel % width % 8]),
    };
    let indices: Vec<u8> = image.pixels().enumerate().map(index).collect();
    Frame {
        delay,
        transparent: Some(UNCHANGED),
        width: width as u16,
        height: height as u16,
        palette: exact.map(|colors| [[0; 3]].into_iter().chain(colors.into_keys()).flatten().collect()),
        buffer: indices.into(),
        ..Frame::default()
    }
}

/// Assigns palette indices to the colours of all changed pixels, in sorted order. Returns `None` if there are
/// more than [`MAX_COLORS`].
fn exact_palette(image: &RgbImage, changed: impl Fn(usize) -> bool) -> Option<BTreeMap<[u8; 3], u8>> {
    let mut colors = BTreeMap::new();
    for (_, rgb) in image.pixels().enumerate().filter(|(pixel, _)| changed(*pixel)) {
        colors.insert(rgb, UNCHANGED);
        if colors.len() > MAX_COLORS {
            return None;
        }
    }
    colors.values_mut().zip(UNCHANGED + 1..=u8::MAX).for_each(|(index, assigned)| *index = assigned);
    Some(colors)
}

/// Quantises a colour to the palette of [`cube`], rounding each channel up or down by an ordered-dither
/// threshold in 1/64.
fn dithered(rgb: [u8; 3], threshold: usize) -> u8 {
    let level = |c: usize| (usize::from(rgb[c]) * (LEVELS[c] - 1) * 64 + threshold * 255 + 127) / (255 * 64);
    1 + ((level(0) * LEVELS[1] + level(1)) * LEVELS[2] + level(2)) as u8
}

/// Returns the palette with all combinations of channel levels, after [`UNCHANGED`].
fn cube() -> Vec<u8> {
    let value = |level: usize, c: usize| (level * 255 / (LEVELS[c] - 1)) as u8;
    let mut palette = vec![0; 3];
    for index in 0..LEVELS.iter().product() {
        let (r, g, b) = (index / (LEVELS[1] * LEVELS[2]), index / LEVELS[2] % LEVELS[1], index % LEVELS[2]);
        palette.extend([value(r, 0), value(g, 1), value(b, 2)]);
    }
    palette
}

const fn bayer() -> [[usize; 8]; 8] {
    let mut matrix = [[0; 8]; 8];
    let mut cell = 0;
    while cell < 64 {
        let (x, y) = (cell % 8, cell / 8);
        // Interleave the bits of x ^ y and y, in reverse order.
        let mut bit = 0;
        while bit < 3 {
            let pair = ((x ^ y) >> bit & 1) << 1 | (y >> bit & 1);
            matrix[y][x] |= pair << (2 * (2 - bit));
            bit += 1;
        }
        cell += 1;
    }
    matrix
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dithering_preserves_mean_color() {
        let palette = cube();
        for rgb in [[0, 0, 0], [255, 255, 255], [10, 100, 200], [77, 31, 250], [128, 128, 128]] {
            let mut sum = [0; 3];
            for threshold in BAYER.into_iter().flatten() {
                let index = usize::from(dithered(rgb, threshold));
                (0..3).for_each(|c| sum[c] += i32::from(palette[index * 3 + c]));
            }
            for c in 0..3 {
                assert!((sum[c] / 64 - i32::from(rgb[c])).abs() <= 2, "{rgb:?} became {sum:?} / 64");
            }
        }
    }

    #[test]
    fn bayer_matrix_contains_every_threshold_once() {
        let mut all: Vec<usize> = BAYER.into_iter().flatten().collect();
        all.sort_unstable();
        assert_eq!(all, (0..64).collect::<Vec<_>>());
    }
}
