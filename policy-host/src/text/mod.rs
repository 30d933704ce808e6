//! Language encoders: an instruction in, its embedding out.
//!
//! A network is used with the encoder it was trained with; its checkpoint says which.

pub mod clip;
pub mod hashed;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use self::clip::{ClipText, Fingerprint};
pub use self::hashed::hashed_embedding;
use crate::checkpoint::{CONFIG_FILE, CheckpointError, MODEL_FILE};

/// Width of the embeddings of CLIP ViT-B/32.
const CLIP_VIT_B_32_DIM: usize = 512;

/// Which encoder a checkpoint was trained with.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "encoder", rename_all = "kebab-case", deny_unknown_fields)]
pub enum LanguageConfig {
    /// [`hashed`]: no weights.
    Hashed {
        /// Width of an embedding.
        dim: usize,
    },
    /// [`clip`]: 512 numbers.
    #[serde(rename = "clip-vit-b-32")]
    ClipVitB32 {
        /// Folder of its `model.safetensors`, from the checkpoint's folder.
        #[serde(default = "clip_folder")]
        weights: PathBuf,
        /// Which weights these must be.
        fingerprint: Fingerprint,
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
    /// [`clip`].
    Clip(Box<ClipText>),
}

impl LanguageConfig {
    /// Width of an embedding.
    #[must_use]
    pub fn dim(&self) -> usize {
        match self {
            Self::Hashed { dim } => *dim,
            Self::ClipVitB32 { .. } => CLIP_VIT_B_32_DIM,
        }
    }
}

impl TextEncoder {
    /// Checks that what the encoder of a checkpoint in `folder` needs is there, by names and shapes alone.
    ///
    /// # Errors
    /// If it is not.
    pub fn check(config: &LanguageConfig, folder: &Path) -> Result<(), CheckpointError> {
        match config {
            LanguageConfig::Hashed { .. } => Ok(()),
            LanguageConfig::ClipVitB32 { weights, .. } => {
                ClipText::check(&folder.join(weights).join(MODEL_FILE), config.dim())
            }
        }
    }

    /// Makes the encoder that a checkpoint in `folder` names.
    ///
    /// # Errors
    /// If its weights cannot be loaded or are not those of the training.
    pub fn open(config: &LanguageConfig, folder: &Path) -> Result<Self, CheckpointError> {
        let (weights, fingerprint) = match config {
            LanguageConfig::Hashed { dim } => return Ok(Self::Hashed { dim: *dim }),
            LanguageConfig::ClipVitB32 { weights, fingerprint } => (weights, *fingerprint),
        };
        let path = folder.join(weights).join(MODEL_FILE);
        let clip = ClipText::load(&path, config.dim())?;
        if clip.fingerprint() == fingerprint {
            return Ok(Self::Clip(Box::new(clip)));
        }
        Err(CheckpointError::Encoder {
            found: clip.fingerprint().to_string(),
            path,
            config: folder.join(CONFIG_FILE),
            expected: fingerprint.to_string(),
        })
    }

    /// The embedding `[dim] f32` of an instruction.
    #[must_use]
    pub fn encode(&self, instruction: &str) -> Vec<f32> {
        match self {
            Self::Hashed { dim } => hashed_embedding(instruction, *dim),
            Self::Clip(clip) => clip.encode(instruction),
        }
    }
}

fn clip_folder() -> PathBuf {
    PathBuf::from("clip")
}
