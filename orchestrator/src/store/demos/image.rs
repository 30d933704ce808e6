//! Image formats of a dataset.

use anyhow::bail;
use clap::ValueEnum;
use ipc_types::ImageSize;
use serde::{Deserialize, Serialize};

/// JPEG quality out of 100, without chroma subsampling.
const JPEG_QUALITY: u8 = 95;

/// The file format of images.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub(crate) enum ImageFormat {
    /// Quality 95, small
    Jpeg,
    /// Lossless, several times as large
    Png,
}

impl ImageFormat {
    /// Encodes an image `[height, width, 3] u8` sRGB.
    ///
    /// # Errors
    /// If the encoder fails.
    pub(crate) fn encode(self, pixels: &[u8], size: ImageSize) -> anyhow::Result<Vec<u8>> {
        let mut file = Vec::new();
        match self {
            Self::Jpeg => {
                let lengths = [size.width, size.height].map(u16::try_from);
                let [Ok(width), Ok(height)] = lengths else {
                    bail!("an image of {size} is too large for JPEG")
                };
                let mut encoder = jpeg_encoder::Encoder::new(&mut file, JPEG_QUALITY);
                encoder.set_sampling_factor(jpeg_encoder::SamplingFactor::F_1_1);
                encoder.encode(pixels, width, height, jpeg_encoder::ColorType::Rgb)?;
            }
            Self::Png => {
                let mut encoder = png::Encoder::new(&mut file, size.width as u32, size.height as u32);
                encoder.set_color(png::ColorType::Rgb);
                encoder.set_compression(png::Compression::Fast);
                encoder.write_header()?.write_image_data(pixels)?;
            }
        }
        Ok(file)
    }
}
