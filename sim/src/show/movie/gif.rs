//! GIF. A frame whose new pixels have few colours gets a palette of exactly those; any other one is dithered to a cube of
//! colours by a pattern that stays where it is, so that what does not move does not flicker.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};

use gif::{Encoder, EncodingError, Frame, Repeat};

use super::FRAMES_PER_S;
use crate::show::contact_sheet::RgbImage;

/// Shades of red, green and blue in the cube: the eye sees green best.
const SHADES: [usize; 3] = [6, 7, 6];
/// Index of the pixels that stay as they are; the colours of a palette come after it.
const STAYS: u8 = 0;
/// Colours that have room in a palette beside that index.
const MAX_COLORS: usize = 255;
/// Thresholds of an 8 × 8 ordered dither, in 1/64 (Bayer, "An optimum method for two-level rendition of continuous-tone
/// pictures", ICC 1973).
const BAYER: [[usize; 8]; 8] = bayer();

/// A GIF in the making.
pub(super) struct Gif(Encoder<BufWriter<File>>);

impl Gif {
    /// Writes the head and the first frame.
    pub(super) fn begin(file: BufWriter<File>, first: &RgbImage) -> Result<Self, EncodingError> {
        let [width, height] = first.size().map(|px| px as u16);
        let mut encoder = Encoder::new(file, width, height, &cube())?;
        encoder.set_repeat(Repeat::Infinite)?;
        encoder.write_frame(&encoded(first, |_| true))?;
        Ok(Self(encoder))
    }

    /// Writes what has changed.
    pub(super) fn push(&mut self, frame: &RgbImage, before: &RgbImage) -> Result<(), EncodingError> {
        let changed: Vec<bool> =
            frame.pixels().zip(before.pixels()).map(|(now, before)| now != before).collect();
        self.0.write_frame(&encoded(frame, |pixel| changed[pixel]))
    }

    /// Writes the end.
    pub(super) fn finish(self) -> Result<(), EncodingError> {
        Ok(self.0.into_inner()?.flush()?)
    }
}

/// A frame of the pixels for which `changed` holds; all others stay.
fn encoded(picture: &RgbImage, changed: impl Fn(usize) -> bool) -> Frame<'static> {
    let [width, height] = picture.size();
    let exact = exact_palette(picture, &changed);
    let index = |(pixel, rgb): (usize, [u8; 3])| match &exact {
        _ if !changed(pixel) => STAYS,
        Some(indices) => indices[&rgb],
        None => dithered(rgb, BAYER[pixel / width % 8][pixel % width % 8]),
    };
    let indices: Vec<u8> = picture.pixels().enumerate().map(index).collect();
    Frame {
        delay: 100 / FRAMES_PER_S,
        transparent: Some(STAYS),
        width: width as u16,
        height: height as u16,
        palette: exact.map(|colors| [[0; 3]].into_iter().chain(colors.into_keys()).flatten().collect()),
        buffer: indices.into(),
        ..Frame::default()
    }
}

/// Indices of the changed pixels' colours, in the colours' order; `None` if there are too many.
fn exact_palette(picture: &RgbImage, changed: impl Fn(usize) -> bool) -> Option<BTreeMap<[u8; 3], u8>> {
    let mut colors = BTreeMap::new();
    for (_, rgb) in picture.pixels().enumerate().filter(|(pixel, _)| changed(*pixel)) {
        colors.insert(rgb, STAYS);
        if colors.len() > MAX_COLORS {
            return None;
        }
    }
    colors.values_mut().zip(STAYS + 1..=u8::MAX).for_each(|(index, place)| *index = place);
    Some(colors)
}

/// Index in the palette of [`cube`] of the shades next below or above a colour's, by a threshold in 1/64.
fn dithered(rgb: [u8; 3], threshold: usize) -> u8 {
    let shade = |c: usize| (usize::from(rgb[c]) * (SHADES[c] - 1) * 64 + threshold * 255 + 127) / (255 * 64);
    1 + ((shade(0) * SHADES[1] + shade(1)) * SHADES[2] + shade(2)) as u8
}

/// Palette of all shades of all channels, after [`STAYS`].
fn cube() -> Vec<u8> {
    let even = |shade: usize, c: usize| (shade * 255 / (SHADES[c] - 1)) as u8;
    let mut palette = vec![0; 3];
    for index in 0..SHADES.iter().product() {
        let (r, g, b) = (index / (SHADES[1] * SHADES[2]), index / SHADES[2] % SHADES[1], index % SHADES[2]);
        palette.extend([even(r, 0), even(g, 1), even(b, 2)]);
    }
    palette
}

const fn bayer() -> [[usize; 8]; 8] {
    let mut matrix = [[0; 8]; 8];
    let mut place = 0;
    while place < 64 {
        let (x, y) = (place % 8, place / 8);
        // The bits of x ^ y and y, interleaved, the lowest ones foremost.
        let mut bit = 0;
        while bit < 3 {
            let pair = ((x ^ y) >> bit & 1) << 1 | (y >> bit & 1);
            matrix[y][x] |= pair << (2 * (2 - bit));
            bit += 1;
        }
        place += 1;
    }
    matrix
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dithering_keeps_the_mean_colour() {
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
    fn every_threshold_occurs_once() {
        let mut all: Vec<usize> = BAYER.into_iter().flatten().collect();
        all.sort_unstable();
        assert_eq!(all, (0..64).collect::<Vec<_>>());
    }
}
