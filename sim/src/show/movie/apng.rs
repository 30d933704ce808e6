//! Animated PNG encoder (PNG specification, third edition, §11.3.6).

use std::fs::File;
use std::io::BufWriter;

use png::{BitDepth, BlendOp, ColorType, EncodingError};

use super::STEPS_PER_S;
use crate::show::MARK;
use crate::show::contact_sheet::RgbImage;

/// An animated PNG file that is being written.
pub(crate) struct Apng(png::Writer<BufWriter<File>>);

impl Apng {
    /// Writes the header and the first frame.
    pub(crate) fn begin(
        file: BufWriter<File>,
        n_frames: usize,
        steps_per_frame: u16,
        first: &RgbImage,
    ) -> Result<Self, EncodingError> {
        let [width, height] = first.size();
        let mut encoder = png::Encoder::new(file, width as u32, height as u32);
        encoder.set_color(ColorType::Rgba);
        encoder.set_depth(BitDepth::Eight);
        encoder.set_animated(n_frames as u32, 0)?;
        encoder.set_frame_delay(steps_per_frame, STEPS_PER_S)?;
        encoder.set_blend_op(BlendOp::Over)?;
        encoder.validate_sequence(true);
        encoder.add_text_chunk("Software".to_owned(), MARK.to_owned())?;
        let mut writer = encoder.write_header()?;
        let opaque: Vec<u8> = first.pixels().flat_map(|[r, g, b]| [r, g, b, u8::MAX]).collect();
        writer.write_image_data(&opaque)?;
        Ok(Self(writer))
    }

    /// Writes the pixels of `frame` that differ from the `previous` frame; all others are transparent.
    pub(crate) fn push(&mut self, frame: &RgbImage, previous: &RgbImage) -> Result<(), EncodingError> {
        let changes: Vec<u8> = frame
            .pixels()
            .zip(previous.pixels())
            .flat_map(
                |(now, previous)| if now == previous { [0; 4] } else { [now[0], now[1], now[2], u8::MAX] },
            )
            .collect();
        self.0.write_image_data(&changes)
    }

    /// Writes the trailing chunks.
    pub(crate) fn finish(self) -> Result<(), EncodingError> {
        self.0.finish()
    }
}
