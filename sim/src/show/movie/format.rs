//! The file formats of movies, selected by the extension.

use std::path::Path;

use thiserror::Error;

/// File format of a movie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MovieFormat {
    /// Animated PNG: lossless.
    Apng,
    /// GIF: smaller; a frame has at most 255 new colours.
    Gif,
    /// MP4 with H.264: smallest; needs `ffmpeg`.
    Mp4,
}

/// File name extensions in lower case.
const EXTENSIONS: [(&str, MovieFormat); 4] = [
    ("png", MovieFormat::Apng),
    ("apng", MovieFormat::Apng),
    ("gif", MovieFormat::Gif),
    ("mp4", MovieFormat::Mp4),
];

/// Error for a path whose extension is not that of a known movie format.
#[derive(Debug, Error, PartialEq, Eq)]
#[error("{path}: a movie's name ends in {}", known_extensions())]
pub struct UnknownFormat {
    path: String,
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

/// Returns the known extensions as a comma-separated list.
fn known_extensions() -> String {
    EXTENSIONS.map(|(name, _)| format!(".{name}")).join(", ")
}
