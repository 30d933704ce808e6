//! CLIP's text encoder, with weights from a file of the user's.
//!
//! It computes what the benchmark's networks were trained with: the projected last token of the text, not normalised. Its
//! size is read off the tensors; a tower's identity is the [`Fingerprint`] over them, whatever file they come from.

mod tensors;
mod tokens;
mod tower;

use std::fmt;
use std::path::Path;

use serde::{Deserialize, Serialize};

pub use self::tensors::TowerShape;
pub use self::tokens::{ClipTokenizer, MAX_TOKENS, VOCABULARY};

use self::tensors::TowerFile;
use self::tower::Tower;
use crate::checkpoint::CheckpointError;

/// Which weights a text tower has: xxh3-64 over name, a zero byte and little-endian f32 numbers of all its tensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Fingerprint(pub u64);

/// A text encoder, ready to run.
#[derive(Debug)]
pub struct ClipText {
    tokenizer: ClipTokenizer,
    tower: Tower,
    fingerprint: Fingerprint,
}

impl ClipText {
    /// Checks the header of a weights file whose embeddings should be `dim` wide.
    ///
    /// # Errors
    /// The first tensor that is missing or has another shape.
    pub fn check(path: &Path, dim: usize) -> Result<(), CheckpointError> {
        TowerFile::open(path)?.check_dim(dim)
    }

    /// Loads a weights file whose embeddings should be `dim` wide.
    ///
    /// # Errors
    /// The first tensor that is missing, has another shape, or cannot be read.
    pub fn load(path: &Path, dim: usize) -> Result<Self, CheckpointError> {
        let file = TowerFile::open(path)?;
        file.check_dim(dim)?;
        let shape = file.shape();
        let (weights, fingerprint) = file.read()?;
        Ok(Self { tokenizer: ClipTokenizer::new(), tower: Tower::new(shape, &weights), fingerprint })
    }

    /// Which weights it has.
    #[must_use]
    pub fn fingerprint(&self) -> Fingerprint {
        self.fingerprint
    }

    /// The embedding `[dim] f32` of a text.
    #[must_use]
    pub fn encode(&self, text: &str) -> Vec<f32> {
        self.tower.run(&self.tokenizer.encode(text))
    }
}

impl fmt::Display for Fingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

impl From<Fingerprint> for String {
    fn from(fingerprint: Fingerprint) -> Self {
        fingerprint.to_string()
    }
}

impl TryFrom<String> for Fingerprint {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let digits = text.len() == 16 && text.bytes().all(|digit| digit.is_ascii_hexdigit());
        let number = u64::from_str_radix(&text, 16).ok().filter(|_| digits);
        number.map(Self).ok_or_else(|| format!("fingerprint `{text}`, expected 16 hexadecimal digits"))
    }
}
