//! Contact sheets: several images side by side in one picture, for people.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::Path;

use thiserror::Error;

/// Pixels around and between images, of the sheet.
const MARGIN: usize = 4;
/// Grey of the margins.
const BACKGROUND: u8 = 96;

/// Failure to write a sheet.
#[derive(Debug, Error)]
pub enum SheetError {
    /// The file could not be created.
    #[error("create {path}: {source}")]
    Create {
        /// Where it should have been.
        path: String,
        /// Reason.
        source: io::Error,
    },
    /// The image could not be written.
    #[error("write {path}: {source}")]
    Write {
        /// Where it was to be.
        path: String,
        /// Reason.
        source: png::EncodingError,
    },
}

/// An image of any size.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    width: usize,
    rgb: Vec<u8>,
}

/// Puts square images, each with its side and its `[side, side, 3] u8` sRGB bytes, row after row of `columns` images,
/// every pixel drawn `upscale` times `upscale`.
///
/// # Panics
/// If there is no image, `columns` or `upscale` is 0, or an image does not have the bytes of its side.
#[must_use]
pub fn compose(images: &[(usize, impl AsRef<[u8]>)], columns: usize, upscale: usize) -> Picture {
    assert!(!images.is_empty() && columns > 0 && upscale > 0, "a sheet has images, columns and a scale");
    let cell = images.iter().map(|(side, _)| side * upscale).max().unwrap_or(0) + MARGIN;
    let columns = columns.min(images.len());
    let (width, height) = (columns * cell + MARGIN, images.len().div_ceil(columns) * cell + MARGIN);
    let mut rgb = vec![BACKGROUND; width * height * 3];
    for (i, (side, bytes)) in images.iter().enumerate() {
        let (side, bytes) = (*side, bytes.as_ref());
        assert_eq!(bytes.len(), side * side * 3, "an image's bytes are [side, side, 3]");
        let (left, top) = (i % columns * cell + MARGIN, i / columns * cell + MARGIN);
        for y in 0..side * upscale {
            for x in 0..side * upscale {
                let from = (y / upscale * side + x / upscale) * 3;
                let to = ((top + y) * width + left + x) * 3;
                rgb[to..to + 3].copy_from_slice(&bytes[from..from + 3]);
            }
        }
    }
    Picture { width, rgb }
}

impl Picture {
    /// Width and height in px.
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.rgb.len() / 3 / self.width]
    }

    /// sRGB of every pixel, row-major, top row first.
    pub fn pixels(&self) -> impl Iterator<Item = [u8; 3]> {
        self.rgb.as_chunks().0.iter().copied()
    }

    /// Writes it to a file.
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
        let written = encoder.write_header().and_then(|mut writer| {
            writer.write_image_data(&self.rgb)?;
            writer.finish()
        });
        written.map_err(|source| SheetError::Write { path: shown(), source })
    }
}
