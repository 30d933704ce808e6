//! Contact sheets: images and their captions, laid out on a grid with margins, as one PNG.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::Path;

use ipc_types::ImageSize;
use thiserror::Error;

use super::MARK;
use super::caption::Font;

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

/// Images side by side, with a caption below them.
#[derive(Clone, Debug)]
pub struct Panel {
    /// Text below the images; empty for none.
    pub caption: String,
    /// Images, each given as its size and its `[height, width, 3] u8` sRGB bytes.
    pub images: Vec<(ImageSize, Vec<u8>)>,
}

/// Lays out panels on a grid of `columns` columns, in row-major order, and repeats every pixel of their
/// images `upscale` times along both axes.
///
/// # Panics
/// If there are no images, if `columns` or `upscale` is 0, or if an image's length does not match its size.
#[must_use]
pub fn compose(panels: &[Panel], columns: usize, upscale: usize) -> RgbImage {
    let sizes = || panels.iter().flat_map(|panel| &panel.images).map(|(size, _)| size);
    assert!(
        columns > 0 && upscale > 0 && sizes().any(|size| size.n_pixels() > 0),
        "a sheet needs at least one image, one column and an upscale factor of at least 1"
    );
    let cell = [sizes().map(|size| size.width).max(), sizes().map(|size| size.height).max()]
        .map(|most| most.unwrap_or(0) * upscale + MARGIN);
    let panel_width = cell[0] * panels.iter().map(|panel| panel.images.len()).max().unwrap_or(0);
    let font = Font::for_width(cell[0]);
    let columns = columns.min(panels.len());
    let mut sheet = RgbImage { width: columns * panel_width + MARGIN, rgb: Vec::new() };
    sheet.extend(MARGIN);
    for row in panels.chunks(columns) {
        let captions = row.iter().map(|panel| font.wrap(&panel.caption, panel_width - MARGIN));
        let captions: Vec<Vec<String>> = captions.collect();
        let text_height = captions.iter().map(|lines| lines.len() * font.height()).max().unwrap_or(0);
        let top = sheet.size()[1];
        sheet.extend(cell[1] + text_height);
        for (column, (panel, lines)) in row.iter().zip(captions).enumerate() {
            let left = column * panel_width + MARGIN;
            for (idx, (size, bytes)) in panel.images.iter().enumerate() {
                sheet.draw_image(*size, bytes, [left + idx * cell[0], top], upscale);
            }
            for (idx, line) in lines.iter().enumerate() {
                let top = top + cell[1] + idx * font.height() - MARGIN / 2;
                font.draw(line, BACKGROUND, |x, y, grey| sheet.set(left + x, top + y, [grey; 3]));
            }
        }
    }
    sheet
}

impl RgbImage {
    /// Returns the width and height in px.
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.rgb.len() / 3 / self.width]
    }

    /// Appends rows of the background colour.
    fn extend(&mut self, n_rows: usize) {
        self.rgb.resize(self.rgb.len() + n_rows * self.width * 3, BACKGROUND);
    }

    fn set(&mut self, x: usize, y: usize, rgb: [u8; 3]) {
        self.rgb[(y * self.width + x) * 3..][..3].copy_from_slice(&rgb);
    }

    fn draw_image(&mut self, size: ImageSize, rgb: &[u8], [left, top]: [usize; 2], upscale: usize) {
        assert_eq!(rgb.len(), size.n_bytes(), "an image must be [height, width, 3] u8");
        let pixels = rgb.as_chunks().0;
        for y in 0..size.height * upscale {
            for x in 0..size.width * upscale {
                self.set(left + x, top + y, pixels[y / upscale * size.width + x / upscale]);
            }
        }
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
