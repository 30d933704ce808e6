//! CLIP's text encoder, with weights from a file supplied by the user.
//!
//! The output is the projected last token, not normalised, as in the training of the benchmark's networks.
//! The size of the tower is derived from its tensors; [`WeightsFingerprint`] identifies the weights whatever
//! file holds them.

mod fingerprint;
mod tensors;
mod tokens;
mod tower;

use std::path::Path;

pub use self::fingerprint::WeightsFingerprint;
pub use self::tensors::TowerShape;
pub use self::tokens::{ClipTokenizer, MAX_TOKENS, VOCABULARY};

use self::tensors::TowerFile;
use self::tower::TextTower;
use crate::weights::WeightsError;

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
