//! Errors of a movie: files and encoders.

use std::io;

use thiserror::Error;

use super::mp4::Mp4Error;

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

/// Errors of the encoders.
#[derive(Debug, Error)]
pub enum EncodeError {
    /// Error of the PNG encoder.
    #[error(transparent)]
    Png(#[from] png::EncodingError),
    /// Error of the GIF encoder.
    #[error(transparent)]
    Gif(#[from] ::gif::EncodingError),
    /// Error of the MP4 encoder.
    #[error(transparent)]
    Mp4(#[from] Mp4Error),
}
