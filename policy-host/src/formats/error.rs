//! Errors of opening and reading a checkpoint folder.

use std::path::PathBuf;

use thiserror::Error;

use super::files::MAPPING_FILE;
use crate::text::EncoderError;
use crate::text::paligemma::TokenizerError;
use crate::weights::{CONFIG_FILE, WeightsError};

/// Errors that can occur while opening or reading a checkpoint folder.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum CheckpointError {
    #[error("failed to read {}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{} is not a valid configuration", path.display())]
    Json { path: PathBuf, source: serde_json::Error },
    #[error("{}: `type` is `{found}`, expected {expected}: {hint}", path.display())]
    Format { path: PathBuf, found: String, expected: &'static str, hint: &'static str },
    #[error(
        "{}: unknown setting `{setting}` ({found}), which may change actions: serve the checkpoint with \
         `python -m hypogeum.lerobot`, whose LeRobot may know it, or list it under `ignore` in {MAPPING_FILE} beside it",
        path.display()
    )]
    UnknownSetting { path: PathBuf, setting: String, found: String },
    #[error(
        "{}: statistics of `{feature}` are missing, which {mode} normalisation needs ({needed}); found {found}. If the \
         network was trained without, set its mode to IDENTITY",
        path.display()
    )]
    Statistics { path: PathBuf, feature: String, mode: &'static str, needed: String, found: String },
    #[error("{}: `{key}` is {found}, expected {expected}", path.display())]
    Value { path: PathBuf, key: String, found: String, expected: String },
    #[error("{}: {reason}", path.display())]
    Mapping { path: PathBuf, reason: String },
    #[error("{}: tensor `{tensor}` ({found}) is not part of the network in {CONFIG_FILE}", path.display())]
    UnexpectedTensor { path: PathBuf, tensor: String, found: String },
    #[error("{}: tensor `{tensor}` contains values that are not finite; has its training diverged?", path.display())]
    NotFinite { path: PathBuf, tensor: String },
    #[error("{}: tensor `{tensor}` contains {found}, expected variances of 0 or more", path.display())]
    NegativeVariance { path: PathBuf, tensor: String, found: f32 },
    #[error(
        "the weights in {} take {needed_mib} MiB of memory, only {available_mib} MiB are available",
        path.display()
    )]
    Memory { path: PathBuf, needed_mib: u64, available_mib: u64 },
    #[error(transparent)]
    Weights(#[from] WeightsError),
    #[error(transparent)]
    Encoder(#[from] EncoderError),
    #[error(transparent)]
    Tokenizer(#[from] TokenizerError),
}

impl CheckpointError {
    /// Returns the error that a configuration has another type, with what to do about it.
    pub(crate) fn format(path: PathBuf, found: &str, expected: &'static str) -> Self {
        let hint = match found {
            "act" | "act_colosseum" => "evaluate it with act:PATH",
            "pi05" => "evaluate it with pi05:PATH",
            _ => "serve it with `python -m hypogeum.lerobot NAME PATH` and evaluate attach:NAME",
        };
        Self::Format { path, found: found.to_owned(), expected, hint }
    }
}
