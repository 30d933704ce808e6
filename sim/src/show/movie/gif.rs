//! GIF encoder. Each frame has a palette of its own, for the pixels that change: exact for up to 255 colours,
//! otherwise Wu's (`quantette`). There is no dithering, which would show as a grid and hardly compresses.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};

use gif::{Encoder, EncodingError, Extension, Frame, Repeat};
use quantette::deps::palette::Srgb;
use quantette::{ImageBuf, PaletteSize, Pipeline};

use super::STEPS_PER_S;
use crate::show::MARK;
use crate::show::contact_sheet::RgbImage;

/// Palette index of unchanged, transparent pixels. The colours of a palette follow it.
const UNCHANGED: u8 = 0;
/// Maximum number of colours in a palette, next to [`UNCHANGED`].
const MAX_COLORS: usize = 255;

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
        let mut encoder = Encoder::new(file, width, height, &[])?;
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
    let pixels = image.pixels().enumerate().filter(|(pixel, _)| changed(*pixel));
    let (palette, index_of) = palette(pixels.map(|(_, rgb)| rgb.into()).collect());
    let index = |(pixel, rgb)| if changed(pixel) { index_of[&rgb] } else { UNCHANGED };
    let indices: Vec<u8> = image.pixels().enumerate().map(index).collect();
    Frame {
        delay,
        transparent: Some(UNCHANGED),
        width: width as u16,
        height: height as u16,
        palette: Some([0; 3].into_iter().chain(palette).collect()),
        buffer: indices.into(),
        ..Frame::default()
    }
}

/// Returns the colours of a palette for these pixels, and the palette index of every colour that occurs.
fn palette(pixels: Vec<Srgb<u8>>) -> (Vec<u8>, BTreeMap<[u8; 3], u8>) {
    let mut index_of: BTreeMap<[u8; 3], u8> = pixels.iter().map(|rgb| ((*rgb).into(), UNCHANGED)).collect();
    if index_of.len() <= MAX_COLORS {
        index_of.values_mut().zip(UNCHANGED + 1..).for_each(|(index, assigned)| *index = assigned);
        return (index_of.keys().flatten().copied().collect(), index_of);
    }
    let image = ImageBuf::new(pixels.len() as u32, 1, pixels).expect("its size is the number of pixels");
    let size = PaletteSize::from_usize_clamped(MAX_COLORS);
    let pipeline = Pipeline::new().palette_size(size).ditherer(None).input_image(image.as_ref());
    let indexed = pipeline.output_srgb8_indexed_image();
    for (rgb, index) in image.as_ref().as_slice().iter().zip(indexed.indices()) {
        index_of.insert((*rgb).into(), UNCHANGED + 1 + index);
    }
    (indexed.palette().iter().flat_map(|rgb| <[u8; 3]>::from(*rgb)).collect(), index_of)
}
