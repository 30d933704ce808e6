//! A file that is not there until it is whole: written as `NAME.part` beside its place, then renamed.

use std::fs::{self, File};
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use super::{CodingError, MovieError};

/// The promise of a file; dropping it removes what was written.
pub(super) struct Draft {
    part: PathBuf,
    path: PathBuf,
}

impl Draft {
    /// Opens the file beside `path`, empty.
    pub(super) fn create(path: &Path) -> io::Result<(Self, BufWriter<File>)> {
        let mut part = path.as_os_str().to_owned();
        part.push(".part");
        let part = PathBuf::from(part);
        let file = File::create(&part)?;
        Ok((Self { part, path: path.to_owned() }, BufWriter::new(file)))
    }

    /// The error of not having been able to write it.
    pub(super) fn failed(&self, source: CodingError) -> MovieError {
        MovieError::Write { path: self.path.display().to_string(), source }
    }

    /// Gives the file its name.
    pub(super) fn publish(self) -> Result<(), MovieError> {
        fs::rename(&self.part, &self.path).map_err(|source| MovieError::Rename {
            part: self.part.display().to_string(),
            path: self.path.display().to_string(),
            source,
        })
    }
}

impl Drop for Draft {
    fn drop(&mut self) {
        // After a rename there is nothing to remove; otherwise there is nobody left to tell.
        let _ = fs::remove_file(&self.part);
    }
}
