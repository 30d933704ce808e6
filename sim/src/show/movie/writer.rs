//! The writer of a movie, whichever its format.

use std::path::Path;

use super::apng::Apng;
use super::error::{EncodeError, MovieError};
use super::format::MovieFormat;
use super::gif::Gif;
use super::mp4::{FFMPEG, Mp4};
use super::part_file::PartFile;
use crate::show::contact_sheet::RgbImage;

/// Writes a movie frame by frame. The file appears under its final path when the movie is finished; an
/// unfinished movie leaves no file behind.
pub struct MovieWriter {
    encoder: Encoder,
    file: PartFile,
    /// The frame written last.
    previous: RgbImage,
}

enum Encoder {
    Apng(Apng),
    Gif(Gif),
    Mp4(Mp4),
}

impl MovieWriter {
    /// Starts a movie of `n_frames` frames, each shown for the duration of `steps_per_frame` control steps.
    /// The first frame determines the size.
    ///
    /// # Errors
    /// If the file cannot be created or written.
    pub fn begin(
        path: &Path,
        format: MovieFormat,
        n_frames: usize,
        steps_per_frame: u16,
        first: RgbImage,
    ) -> Result<Self, MovieError> {
        let (file, buffer) = PartFile::create(path)
            .map_err(|source| MovieError::Create { path: path.display().to_string(), source })?;
        let encoder = match format {
            MovieFormat::Apng => Apng::begin(buffer, n_frames, steps_per_frame, &first)
                .map(Encoder::Apng)
                .map_err(EncodeError::from),
            MovieFormat::Gif => {
                Gif::begin(buffer, steps_per_frame, &first).map(Encoder::Gif).map_err(EncodeError::from)
            }
            MovieFormat::Mp4 => Mp4::begin(Path::new(FFMPEG), file.part_path(), steps_per_frame, &first)
                .map(Encoder::Mp4)
                .map_err(EncodeError::from),
        };
        Ok(Self { encoder: encoder.map_err(|source| file.write_error(source))?, file, previous: first })
    }

    /// Appends a frame.
    ///
    /// # Errors
    /// If the frame cannot be written.
    ///
    /// # Panics
    /// If its size differs from that of the first frame.
    pub fn push(&mut self, frame: RgbImage) -> Result<(), MovieError> {
        assert_eq!(frame.size(), self.previous.size(), "all frames of a movie have the same size");
        match &mut self.encoder {
            Encoder::Apng(apng) => apng.push(&frame, &self.previous).map_err(EncodeError::from),
            Encoder::Gif(gif) => gif.push(&frame, &self.previous).map_err(EncodeError::from),
            Encoder::Mp4(mp4) => mp4.push(&frame).map_err(EncodeError::from),
        }
        .map_err(|source| self.file.write_error(source))?;
        self.previous = frame;
        Ok(())
    }

    /// Completes the movie and renames the file to its final path.
    ///
    /// # Errors
    /// If frames are missing or the file cannot be written or renamed.
    pub fn finish(self) -> Result<(), MovieError> {
        match self.encoder {
            Encoder::Apng(apng) => apng.finish().map_err(EncodeError::from),
            Encoder::Gif(gif) => gif.finish().map_err(EncodeError::from),
            Encoder::Mp4(mp4) => mp4.finish().map_err(EncodeError::from),
        }
        .map_err(|source| self.file.write_error(source))?;
        self.file.publish()
    }
}
