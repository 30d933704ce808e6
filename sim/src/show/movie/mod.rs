//! Movies that play at the speed of the simulation, in file formats that play wherever images are displayed.
//!
//! Most pixels do not change from one frame to the next. They are encoded as transparent, which takes almost
//! no space in either format.

mod apng;
mod gif;
mod part_file;
#[cfg(test)]
mod tests;

use std::io;
use std::path::Path;

use thiserror::Error;

use crate::physics::CONTROL_HZ;
use crate::show::contact_sheet::RgbImage;
use apng::Apng;
use gif::Gif;
use part_file::PartFile;

/// Control steps per second, which movies play in real time.
const STEPS_PER_S: u16 = CONTROL_HZ as u16;

/// File format of a movie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MovieFormat {
    /// Animated PNG: lossless.
    Apng,
    /// GIF: smaller; frames with more than 255 new colours are dithered.
    Gif,
}

/// File name extensions in lower case.
const EXTENSIONS: [(&str, MovieFormat); 3] =
    [("png", MovieFormat::Apng), ("apng", MovieFormat::Apng), ("gif", MovieFormat::Gif)];

/// Error for a path whose extension is not that of a known movie format.
#[derive(Debug, Error, PartialEq, Eq)]
#[error("{path}: a movie's name ends in {}", known_extensions())]
pub struct UnknownFormat {
    path: String,
}

/// Errors that can occur while writing a movie.
#[derive(Debug, Error)]
pub enum MovieError {
    /// The file could not be created.
    #[error("failed to create {path}")]
    Create {
        /// Path of the file.
        path: String,
        /// Underlying I/O or encoder error.
        source: io::Error,
    },
    /// A frame could not be written.
    #[error("failed to write {path}")]
    Write {
        /// Path of the file.
        path: String,
        /// Underlying I/O or encoder error.
        source: EncodeError,
    },
    /// The complete file could not be renamed to its final path.
    #[error("failed to rename {part} to {path}")]
    Rename {
        /// Path of the complete file.
        part: String,
        /// Final path of the file.
        path: String,
        /// Underlying I/O or encoder error.
        source: io::Error,
    },
}

/// Errors of the image encoders.
#[derive(Debug, Error)]
pub enum EncodeError {
    /// Error of the PNG encoder.
    #[error(transparent)]
    Png(#[from] png::EncodingError),
    /// Error of the GIF encoder.
    #[error(transparent)]
    Gif(#[from] ::gif::EncodingError),
}

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
}

impl MovieFormat {
    /// Selects the format by the path's extension, ignoring case.
    ///
    /// # Errors
    /// If the extension is unknown.
    pub fn from_path(path: &Path) -> Result<Self, UnknownFormat> {
        let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
        let known = EXTENSIONS.iter().find(|(name, _)| name.eq_ignore_ascii_case(extension));
        known.map(|(_, format)| *format).ok_or_else(|| UnknownFormat { path: path.display().to_string() })
    }
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
        }
        .map_err(|source| self.file.write_error(source))?;
        self.file.publish()
    }
}

/// Returns the known extensions as a comma-separated list.
fn known_extensions() -> String {
    EXTENSIONS.map(|(name, _)| format!(".{name}")).join(", ")
}
