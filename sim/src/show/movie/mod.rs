//! Movies for people: pictures one after the other at the rate of control, in a file that plays where pictures are shown.
//!
//! Most of a frame is the same as before. Such pixels are left transparent over what is there already, which costs next to
//! nothing in either format.

mod apng;
mod draft;
mod gif;
#[cfg(test)]
mod tests;

use std::io;
use std::path::Path;

use thiserror::Error;

use crate::physics::CONTROL_HZ;
use crate::show::contact_sheet::RgbImage;
use apng::Apng;
use draft::Draft;
use gif::Gif;

/// Frames per second: one per control step.
pub const FRAMES_PER_S: u16 = CONTROL_HZ as u16;

/// A kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Animated PNG: the pictures to the bit.
    Apng,
    /// GIF: smaller, and dithered where a frame has more colours than the format.
    Gif,
}

/// Extensions of movie files, in lower case.
const EXTENSIONS: [(&str, Format); 3] = [("png", Format::Apng), ("apng", Format::Apng), ("gif", Format::Gif)];

/// A file name that says no known kind of movie.
#[derive(Debug, Error, PartialEq, Eq)]
#[error("{path}: a movie's name ends in {}", known())]
pub struct UnknownFormat {
    path: String,
}

/// Failure to write a movie.
#[derive(Debug, Error)]
pub enum MovieError {
    /// The file could not be created.
    #[error("create {path}: {source}")]
    Create {
        /// Where it should have been.
        path: String,
        /// Reason.
        source: io::Error,
    },
    /// A frame could not be written.
    #[error("write {path}: {source}")]
    Write {
        /// Where it was to be.
        path: String,
        /// Reason.
        source: CodingError,
    },
    /// The whole file could not take its name.
    #[error("rename {part} to {path}: {source}")]
    Rename {
        /// Where it is.
        part: String,
        /// Where it should be.
        path: String,
        /// Reason.
        source: io::Error,
    },
}

/// What an encoder says.
#[derive(Debug, Error)]
pub enum CodingError {
    /// Of PNG.
    #[error(transparent)]
    Png(#[from] png::EncodingError),
    /// Of GIF.
    #[error(transparent)]
    Gif(#[from] ::gif::EncodingError),
}

/// A movie in the making. Its file takes its name when it is finished; an unfinished one leaves nothing.
pub struct Movie {
    encoder: Encoder,
    draft: Draft,
    /// The last frame.
    shown: RgbImage,
}

enum Encoder {
    Apng(Apng),
    Gif(Gif),
}

impl Format {
    /// By the path's extension, in whatever case.
    ///
    /// # Errors
    /// If it is none of the known ones.
    pub fn of(path: &Path) -> Result<Self, UnknownFormat> {
        let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
        let known = EXTENSIONS.iter().find(|(name, _)| name.eq_ignore_ascii_case(extension));
        known.map(|(_, format)| *format).ok_or_else(|| UnknownFormat { path: path.display().to_string() })
    }
}

impl Movie {
    /// Begins a movie of `n_frames` with its first one, which sets the size.
    ///
    /// # Errors
    /// If the file cannot be created or written.
    pub fn begin(path: &Path, format: Format, n_frames: usize, first: RgbImage) -> Result<Self, MovieError> {
        let (draft, file) = Draft::create(path)
            .map_err(|source| MovieError::Create { path: path.display().to_string(), source })?;
        let encoder = match format {
            Format::Apng => Apng::begin(file, n_frames, &first).map(Encoder::Apng).map_err(CodingError::from),
            Format::Gif => Gif::begin(file, &first).map(Encoder::Gif).map_err(CodingError::from),
        };
        Ok(Self { encoder: encoder.map_err(|source| draft.failed(source))?, draft, shown: first })
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// If it cannot be written.
    ///
    /// # Panics
    /// If it has another size than the first one.
    pub fn push(&mut self, frame: RgbImage) -> Result<(), MovieError> {
        assert_eq!(frame.size(), self.shown.size(), "the frames of a movie are equally large");
        match &mut self.encoder {
            Encoder::Apng(apng) => apng.push(&frame, &self.shown).map_err(CodingError::from),
            Encoder::Gif(gif) => gif.push(&frame, &self.shown).map_err(CodingError::from),
        }
        .map_err(|source| self.draft.failed(source))?;
        self.shown = frame;
        Ok(())
    }

    /// Ends the movie and gives the file its name.
    ///
    /// # Errors
    /// If frames are missing or the file cannot be written or renamed.
    pub fn finish(self) -> Result<(), MovieError> {
        match self.encoder {
            Encoder::Apng(apng) => apng.finish().map_err(CodingError::from),
            Encoder::Gif(gif) => gif.finish().map_err(CodingError::from),
        }
        .map_err(|source| self.draft.failed(source))?;
        self.draft.publish()
    }
}

/// The known extensions as a list.
fn known() -> String {
    EXTENSIONS.map(|(name, _)| format!(".{name}")).join(", ")
}
