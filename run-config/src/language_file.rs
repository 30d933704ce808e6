//! The file of paraphrases that replaces the built-in ones.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;
use xxhash_rust::xxh3::xxh3_64;

use crate::input;

/// Maximum size of the file in bytes; the benchmark's has 29,599.
const MAX_BYTES: usize = 1 << 20;

/// A file of paraphrases, identified by its content. The sim reads its sentences.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LanguageFile {
    path: PathBuf,
    /// Hash of the content, 16 hexadecimal digits.
    fingerprint: String,
}

/// Errors that can occur while reading a file of paraphrases.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages describe the variants")]
pub enum LanguageFileError {
    #[error("failed to read {}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{} has {found} bytes, expected at most {MAX_BYTES}", path.display())]
    TooLarge { path: PathBuf, found: usize },
    #[error("{} is not UTF-8 text", path.display())]
    NotText { path: PathBuf },
    #[error("{} has changed since the run began: its content hash is {found}, expected {expected}", path.display())]
    Changed { path: PathBuf, found: String, expected: String },
}

impl LanguageFile {
    /// Identifies the file at `path` by its content.
    ///
    /// # Errors
    /// If it cannot be read, or is too large to be a file of paraphrases.
    pub fn open(path: &Path) -> Result<Self, LanguageFileError> {
        let (_, fingerprint) = read(path)?;
        Ok(Self { path: path.into(), fingerprint })
    }

    /// Returns the path as given on the command line.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Reads the text.
    ///
    /// # Errors
    /// If the file cannot be read, is not text, or no longer has the content that identifies it.
    pub fn text(&self) -> Result<String, LanguageFileError> {
        let (bytes, found) = read(&self.path)?;
        if found != self.fingerprint {
            let expected = self.fingerprint.clone();
            return Err(LanguageFileError::Changed { path: self.path.clone(), found, expected });
        }
        String::from_utf8(bytes).map_err(|_| LanguageFileError::NotText { path: self.path.clone() })
    }
}

fn read(path: &Path) -> Result<(Vec<u8>, String), LanguageFileError> {
    let bytes = input::read(path).map_err(|source| LanguageFileError::Read { path: path.into(), source })?;
    if bytes.len() > MAX_BYTES {
        return Err(LanguageFileError::TooLarge { path: path.into(), found: bytes.len() });
    }
    let fingerprint = format!("{:016x}", xxh3_64(&bytes));
    Ok((bytes, fingerprint))
}

impl FromStr for LanguageFile {
    type Err = String;

    /// Opens the file; the message includes the cause, because clap prints only the error itself.
    fn from_str(path: &str) -> Result<Self, String> {
        Self::open(Path::new(path)).map_err(|error| crate::error_chain(&error))
    }
}
