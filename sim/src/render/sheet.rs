//! Contact sheets: several images side by side in one PNG, for people.

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

/// Writes square images, each with its side and its `[side, side, 3] u8` sRGB bytes, row after row of `columns` images,
/// every pixel drawn `upscale` times `upscale`.
///
/// # Errors
/// If the file cannot be created or written.
///
/// # Panics
/// If there is no image, `columns` or `upscale` is 0, or an image does not have the bytes of its side.
pub fn write_png(
    path: &Path,
    images: &[(usize, &[u8])],
    columns: usize,
    upscale: usize,
) -> Result<(), SheetError> {
    assert!(!images.is_empty() && columns > 0 && upscale > 0, "a sheet has images, columns and a scale");
    let cell = images.iter().map(|(side, _)| side * upscale).max().unwrap_or(0) + MARGIN;
    let columns = columns.min(images.len());
    let (width, height) = (columns * cell + MARGIN, images.len().div_ceil(columns) * cell + MARGIN);
    let mut sheet = vec![BACKGROUND; width * height * 3];
    for (i, &(side, bytes)) in images.iter().enumerate() {
        assert_eq!(bytes.len(), side * side * 3, "an image's bytes are [side, side, 3]");
        let (left, top) = (i % columns * cell + MARGIN, i / columns * cell + MARGIN);
        for y in 0..side * upscale {
            for x in 0..side * upscale {
                let from = (y / upscale * side + x / upscale) * 3;
                let to = ((top + y) * width + left + x) * 3;
                sheet[to..to + 3].copy_from_slice(&bytes[from..from + 3]);
            }
        }
    }
    let shown = || path.display().to_string();
    let file = File::create(path).map_err(|source| SheetError::Create { path: shown(), source })?;
    let mut encoder = png::Encoder::new(BufWriter::new(file), width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(&sheet)?;
        writer.finish()
    });
    written.map_err(|source| SheetError::Write { path: shown(), source })
}
