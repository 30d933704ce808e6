//! Language encoders: an instruction in, its embedding out.
//!
//! A network is used with the encoder it was trained with; its checkpoint says which.

pub mod hashed;

use std::path::Path;

use serde::{Deserialize, Serialize};

pub use self::hashed::hashed_embedding;
use crate::checkpoint::CheckpointError;

/// Which encoder a checkpoint was trained with.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "encoder", rename_all = "kebab-case", deny_unknown_fields)]
pub enum LanguageConfig {
    /// [`hashed`]: no weights.
    Hashed {
        /// Width of an embedding.
        dim: usize,
    },
}

/// An encoder, ready to run.
#[derive(Debug)]
pub enum TextEncoder {
    /// [`hashed`], of this width.
    Hashed {
        /// Width of an embedding.
        dim: usize,
    },
}

impl LanguageConfig {
    /// Width of an embedding.
    #[must_use]
    pub fn dim(&self) -> usize {
        match self {
            Self::Hashed { dim } => *dim,
        }
    }
}

impl TextEncoder {
    /// Makes the encoder that a checkpoint in `folder` names.
    ///
    /// # Errors
    /// If its weights cannot be loaded or are not those of the training.
    pub fn open(config: &LanguageConfig, _folder: &Path) -> Result<Self, CheckpointError> {
        match config {
            LanguageConfig::Hashed { dim } => Ok(Self::Hashed { dim: *dim }),
        }
    }

    /// The embedding `[dim] f32` of an instruction.
    #[must_use]
    pub fn encode(&self, instruction: &str) -> Vec<f32> {
        match self {
            Self::Hashed { dim } => hashed_embedding(instruction, *dim),
        }
    }
}
