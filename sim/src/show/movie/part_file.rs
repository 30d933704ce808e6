//! Atomic file creation: a file is written as `NAME.part` next to its final path and renamed when it is
//! complete.

use std::fs::{self, File};
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use super::error::{EncodeError, MovieError};

/// An incomplete file. Dropping the value removes it.
pub(crate) struct PartFile {
    part_path: PathBuf,
    path: PathBuf,
}

impl PartFile {
    /// Creates the `.part` file of `path`.
    pub(crate) fn create(path: &Path) -> io::Result<(Self, BufWriter<File>)> {
        let mut part = path.as_os_str().to_owned();
        part.push(".part");
        let part = PathBuf::from(part);
        let file = File::create(&part)?;
        Ok((Self { part_path: part, path: path.to_owned() }, BufWriter::new(file)))
    }

    /// Returns the path of the incomplete file.
    pub(crate) fn part_path(&self) -> &Path {
        &self.part_path
    }

    /// Wraps an encoder error with the path of the file.
    pub(crate) fn write_error(&self, source: EncodeError) -> MovieError {
        MovieError::Write { path: self.path.display().to_string(), source }
    }

    /// Renames the file to its final path.
    pub(crate) fn publish(self) -> Result<(), MovieError> {
        fs::rename(&self.part_path, &self.path).map_err(|source| MovieError::Rename {
            part: self.part_path.display().to_string(),
            path: self.path.display().to_string(),
            source,
        })
    }
}

impl Drop for PartFile {
    fn drop(&mut self) {
        // After the rename there is no file to remove, and an error could not be reported from here anyway.
        let _ = fs::remove_file(&self.part_path);
    }
}
