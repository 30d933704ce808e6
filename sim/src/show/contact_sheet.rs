//! Contact sheets: several square images laid out on a grid with margins, as one PNG.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::Path;

use thiserror::Error;

use super::MARK;

/// Width of the gap around and between images, in px of the sheet.
const MARGIN: usize = 4;
/// Grey level of the margins.
const BACKGROUND: u8 = 96;

/// Errors that can occur while writing a contact sheet.
#[derive(Debug, Error)]
pub enum SheetError {
    /// The file could not be created.
    #[error("failed to create {path}")]
    Create {
        /// Path of the file.
        path: String,
        /// Underlying I/O error.
        source: io::Error,
    },
    /// The image could not be encoded or written.
    #[error("failed to write {path}")]
    Write {
        /// Path of the file.
        path: String,
        /// Underlying encoder error.
        source: png::EncodingError,
    },
}

/// An 8-bit sRGB image of any size.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RgbImage {
    width: usize,
    /// `[height, width, 3]`, row-major, top row first.
    rgb: Vec<u8>,
}

/// Lays out square images on a grid of `columns` columns, in row-major order, and repeats every pixel
/// `upscale` times along both axes. Each image is given as its side and its `[side, side, 3] u8` sRGB bytes.
///
/// # Panics
/// If there are no images, if `columns` or `upscale` is 0, or if an image's length does not match its side.
#[must_use]
pub fn compose(images: &[(usize, impl AsRef<[u8]>)], columns: usize, upscale: usize) -> RgbImage {
    assert!(
        !images.is_empty() && columns > 0 && upscale > 0,
        "a sheet needs at least one image, one column and an upscale factor of at least 1"
    );
    let cell = images.iter().map(|(side, _)| side * upscale).max().unwrap_or(0) + MARGIN;
    let columns = columns.min(images.len());
    let (width, height) = (columns * cell + MARGIN, images.len().div_ceil(columns) * cell + MARGIN);
    let mut rgb = vec![BACKGROUND; width * height * 3];
    for (i, (side, bytes)) in images.iter().enumerate() {
        let (side, bytes) = (*side, bytes.as_ref());
        assert_eq!(bytes.len(), side * side * 3, "an image must be [side, side, 3] u8");
        let (left, top) = (i % columns * cell + MARGIN, i / columns * cell + MARGIN);
        for y in 0..side * upscale {
            for x in 0..side * upscale {
                let from = (y / upscale * side + x / upscale) * 3;
                let to = ((top + y) * width + left + x) * 3;
                rgb[to..to + 3].copy_from_slice(&bytes[from..from + 3]);
            }
        }
    }
    RgbImage { width, rgb }
}

impl RgbImage {
    /// Returns the width and height in px.
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.rgb.len() / 3 / self.width]
    }

    /// Iterates over the sRGB values of all pixels, row-major, top row first.
    pub fn pixels(&self) -> impl Iterator<Item = [u8; 3]> {
        self.rgb.as_chunks().0.iter().copied()
    }

    /// Writes the image to a PNG file.
    ///
    /// # Errors
    /// If the file cannot be created or written.
    pub fn write_png(&self, path: &Path) -> Result<(), SheetError> {
        let shown = || path.display().to_string();
        let file = File::create(path).map_err(|source| SheetError::Create { path: shown(), source })?;
        let [width, height] = self.size();
        let mut encoder = png::Encoder::new(BufWriter::new(file), width as u32, height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let marked = encoder.add_text_chunk("Software".to_owned(), MARK.to_owned());
        let written = marked.and_then(|()| encoder.write_header()).and_then(|mut writer| {
            writer.write_image_data(&self.rgb)?;
            writer.finish()
        });
        written.map_err(|source| SheetError::Write { path: shown(), source })
    }
}
