//! CLIP's text encoder, with weights from a file supplied by the user.
//!
//! The output is the projected last token, not normalised, as in the training of the benchmark's networks.
//! The size of the tower is derived from its tensors; [`WeightsFingerprint`] identifies the weights whatever
//! file holds them.

mod tensors;
mod tokens;
mod tower;

use std::fmt;
use std::path::Path;

use serde::{Deserialize, Serialize};

pub use self::tensors::TowerShape;
pub use self::tokens::{ClipTokenizer, MAX_TOKENS, VOCABULARY};

use self::tensors::TowerFile;
use self::tower::TextTower;
use crate::weights::WeightsError;

/// Identity of a text tower's weights: xxh3-64 over all tensors, each as its name, a zero byte and its values
/// as little-endian f32.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct WeightsFingerprint(pub u64);

/// A loaded CLIP text encoder: tokenizer and text tower.
#[derive(Debug)]
pub struct ClipText {
    tokenizer: ClipTokenizer,
    tower: TextTower,
    fingerprint: WeightsFingerprint,
}

impl ClipText {
    /// Checks the header of a weights file for embeddings of dimension `dim`.
    ///
    /// # Errors
    /// The first tensor that is missing or has a different shape.
    pub fn check(path: &Path, dim: usize) -> Result<(), WeightsError> {
        TowerFile::open(path)?.check_dim(dim)
    }

    /// Loads a weights file for embeddings of dimension `dim`.
    ///
    /// # Errors
    /// The first tensor that is missing, has a different shape, or cannot be read.
    pub fn load(path: &Path, dim: usize) -> Result<Self, WeightsError> {
        let file = TowerFile::open(path)?;
        file.check_dim(dim)?;
        let shape = file.shape();
        let (state_dict, fingerprint) = file.read()?;
        Ok(Self { tokenizer: ClipTokenizer::new(), tower: TextTower::new(shape, &state_dict), fingerprint })
    }

    /// Returns the fingerprint of the weights.
    #[must_use]
    pub fn fingerprint(&self) -> WeightsFingerprint {
        self.fingerprint
    }

    /// Returns the embedding `[dim] f32` of a text.
    #[must_use]
    pub fn encode(&self, text: &str) -> Vec<f32> {
        self.tower.forward(&self.tokenizer.encode(text))
    }
}

impl fmt::Display for WeightsFingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

impl From<WeightsFingerprint> for String {
    fn from(fingerprint: WeightsFingerprint) -> Self {
        fingerprint.to_string()
    }
}

impl TryFrom<String> for WeightsFingerprint {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let digits = text.len() == 16 && text.bytes().all(|digit| digit.is_ascii_hexdigit());
        let number = u64::from_str_radix(&text, 16).ok().filter(|_| digits);
        number.map(Self).ok_or_else(|| format!("fingerprint `{text}`, expected 16 hexadecimal digits"))
    }
}
