//! Text: language encoders, which map an instruction to its embedding, and the vocabulary of π0.5.
//!
//! A network only works with the encoder it was trained with; its checkpoint names that encoder.

pub mod clip;
pub mod hashed;
pub mod paligemma;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use thiserror::Error;

use self::clip::{ClipText, WeightsFingerprint};
pub use self::hashed::hashed_embedding;
use crate::weights::{CONFIG_FILE, MODEL_FILE, WeightsError};

/// Embedding dimension of CLIP ViT-B/32.
const CLIP_VIT_B_32_DIM: usize = 512;

/// Configuration of a language encoder, as a checkpoint stores it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "encoder", rename_all = "kebab-case", deny_unknown_fields)]
pub enum LanguageConfig {
    /// The weight-free encoder in [`hashed`].
    Hashed {
        /// Dimension of an embedding.
        dim: usize,
    },
    /// The text encoder of CLIP ViT-B/32 ([`clip`]), with 512-dimensional embeddings.
    #[serde(rename = "clip-vit-b-32")]
    ClipVitB32 {
        /// Folder of its `model.safetensors`, relative to the checkpoint folder.
        #[serde(default = "clip_folder")]
        weights: PathBuf,
        /// Fingerprint of the weights used for training.
        fingerprint: WeightsFingerprint,
    },
}

/// A loaded language encoder.
#[derive(Debug)]
pub enum TextEncoder {
    /// The weight-free encoder in [`hashed`].
    Hashed {
        /// Dimension of an embedding.
        dim: usize,
    },
    /// The text encoder of CLIP ([`clip`]).
    Clip(Box<ClipText>),
}

/// Errors that can occur while loading a language encoder.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum EncoderError {
    #[error(transparent)]
    Weights(#[from] WeightsError),
    #[error(
        "{} has the fingerprint {found}, the network of {} was trained with {expected}",
        path.display(), config.display()
    )]
    Fingerprint { path: PathBuf, config: PathBuf, expected: WeightsFingerprint, found: WeightsFingerprint },
}

impl LanguageConfig {
    /// Returns the dimension of an embedding.
    #[must_use]
    pub fn dim(&self) -> usize {
        match self {
            Self::Hashed { dim } => *dim,
            Self::ClipVitB32 { .. } => CLIP_VIT_B_32_DIM,
        }
    }
}

impl TextEncoder {
    /// Checks the encoder's weights for a checkpoint in `folder`, by tensor names and shapes alone.
    ///
    /// # Errors
    /// If a file or tensor is missing or differs.
    pub fn check(config: &LanguageConfig, folder: &Path) -> Result<(), EncoderError> {
        match config {
            LanguageConfig::Hashed { .. } => Ok(()),
            LanguageConfig::ClipVitB32 { weights, .. } => {
                Ok(ClipText::check(&folder.join(weights).join(MODEL_FILE), config.dim())?)
            }
        }
    }

    /// Loads the encoder of a checkpoint in `folder`.
    ///
    /// # Errors
    /// If the weights cannot be loaded or their fingerprint is not the one in `config`.
    pub fn open(config: &LanguageConfig, folder: &Path) -> Result<Self, EncoderError> {
        let (weights, fingerprint) = match config {
            LanguageConfig::Hashed { dim } => return Ok(Self::Hashed { dim: *dim }),
            LanguageConfig::ClipVitB32 { weights, fingerprint } => (weights, *fingerprint),
        };
        let path = folder.join(weights).join(MODEL_FILE);
        let clip = ClipText::load(&path, config.dim())?;
        if clip.fingerprint() == fingerprint {
            return Ok(Self::Clip(Box::new(clip)));
        }
        let (config, found) = (folder.join(CONFIG_FILE), clip.fingerprint());
        Err(EncoderError::Fingerprint { path, config, expected: fingerprint, found })
    }

    /// Returns the embedding `[dim] f32` of an instruction.
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
