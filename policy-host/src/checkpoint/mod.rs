//! Checkpoint folders of ACT: the benchmark's, LeRobot's, and what both come down to.
//!
//! A folder holds `config.json`, whose `type` says which kind it is, and `model.safetensors`; LeRobot's also its processors'
//! files. Everything is checked by name, type and shape before a tensor is read.

pub mod colosseum;
pub mod file;
pub mod lerobot;
pub mod mapping;

mod processor;
mod weights;

use std::path::{Path, PathBuf};

use serde::Deserialize;
use thiserror::Error;

use self::file::TensorFile;
pub use self::mapping::Wiring;
pub use self::weights::Weights;
use crate::act::architecture::{Architecture, BadValue};
use crate::act::normalise::Normalisation;
use crate::act::tensors::tensor_specs;
use crate::text::{LanguageConfig, TextEncoder};

/// Name of the configuration in a checkpoint folder.
pub const CONFIG_FILE: &str = "config.json";
/// Name of the weights in a checkpoint folder.
pub const MODEL_FILE: &str = "model.safetensors";

/// A checkpoint folder that cannot be used.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the fields are named by their messages")]
pub enum CheckpointError {
    #[error("read {}: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("use {}: {source}", path.display())]
    Json { path: PathBuf, source: serde_json::Error },
    #[error("use {}: `type` is `{found}`, expected `act_colosseum` or LeRobot's `act`", path.display())]
    Kind { path: PathBuf, found: String },
    #[error("use {}: `{key}` is {found}, expected {expected}", path.display())]
    Value { path: PathBuf, key: String, found: String, expected: String },
    #[error("use {}: {reason}", path.display())]
    Wiring { path: PathBuf, reason: String },
    #[error("read {}: not a safetensors file ({reason})", path.display())]
    Header { path: PathBuf, reason: String },
    #[error("read {}: its header describes {expected} bytes, the file has {found}: truncated or overwritten", path.display())]
    Length { path: PathBuf, expected: u64, found: u64 },
    #[error("use {}: tensor `{tensor}` is missing, expected {expected}", path.display())]
    Missing { path: PathBuf, tensor: String, expected: String },
    #[error("use {}: tensor `{tensor}` ({found}) belongs to no network of this {CONFIG_FILE}", path.display())]
    Unknown { path: PathBuf, tensor: String, found: String },
    #[error("use {}: tensor `{tensor}` is {found}, expected {expected}", path.display())]
    Mismatch { path: PathBuf, tensor: String, expected: String, found: String },
    #[error(
        "use {}: these weights have the fingerprint {found}, the network beside {} was trained with {expected}",
        path.display(), config.display()
    )]
    Encoder { path: PathBuf, config: PathBuf, expected: String, found: String },
}

/// What a folder's configuration says.
#[derive(Debug)]
struct Description {
    architecture: Architecture,
    normalisation: Normalisation,
    naming: Naming,
    /// How the robot's observation becomes the network's input, or why it cannot.
    wiring: Result<Wiring, String>,
    language: Option<LanguageConfig>,
    /// Decay of a temporal ensemble's weights, where the folder names one.
    ensemble_decay: Option<f64>,
}

/// How a kind of checkpoint names its tensors.
#[derive(Debug)]
struct Naming {
    /// Beginnings of the benchmark's names and what stands in their place; the first that fits counts.
    prefixes: &'static [(&'static str, &'static str)],
    /// Beginnings of names, as stored, that inference does not need.
    unused: Vec<String>,
}

/// Counters that PyTorch's BatchNorm keeps: accepted in any type and ignored.
const IGNORED_SUFFIX: &str = ".num_batches_tracked";

/// A checkpoint whose configuration and header have been checked.
#[derive(Debug)]
pub struct Checkpoint {
    folder: PathBuf,
    description: Description,
    tensors: TensorFile,
}

/// The only key that every configuration has.
#[derive(Deserialize)]
struct Kind {
    #[serde(rename = "type")]
    kind: String,
}

impl Checkpoint {
    /// Reads the configuration in `folder` and the header of its weights, and checks one against the other.
    ///
    /// # Errors
    /// The first thing that does not fit, with file, tensor, what was found and what was expected.
    pub fn open(folder: &Path) -> Result<Self, CheckpointError> {
        let path = folder.join(CONFIG_FILE);
        let text =
            std::fs::read(&path).map_err(|source| CheckpointError::Read { path: path.clone(), source })?;
        let Kind { kind } = parse(&path, &text)?;
        let mut tensors = None;
        let description = match kind.as_str() {
            "act_colosseum" => colosseum::describe(&path, &text, &mut tensors),
            "act" => lerobot::describe(folder, &text, &mut tensors),
            _ => Err(CheckpointError::Kind { path: path.clone(), found: kind }),
        }?;
        description.architecture.check().map_err(|BadValue { name, found, expected }| {
            CheckpointError::Value { path, key: name.to_owned(), found: found.to_string(), expected }
        })?;
        let tensors = match tensors {
            Some(tensors) => tensors,
            None => TensorFile::open(&folder.join(MODEL_FILE))?,
        };
        let checkpoint = Self { folder: folder.to_owned(), description, tensors };
        checkpoint.check_tensors()?;
        Ok(checkpoint)
    }

    /// The network's shape.
    #[must_use]
    pub fn architecture(&self) -> &Architecture {
        &self.description.architecture
    }

    /// What its numbers go through.
    #[must_use]
    pub fn normalisation(&self) -> &Normalisation {
        &self.description.normalisation
    }

    /// How the robot's observation becomes the network's input.
    ///
    /// # Errors
    /// If it cannot: both sides are listed.
    pub fn wiring(&self) -> Result<&Wiring, CheckpointError> {
        self.description.wiring.as_ref().map_err(|reason| CheckpointError::Wiring {
            path: self.folder.join(CONFIG_FILE),
            reason: reason.clone(),
        })
    }

    /// Decay of a temporal ensemble's weights, where the checkpoint names one.
    #[must_use]
    pub fn ensemble_decay(&self) -> Option<f64> {
        self.description.ensemble_decay
    }

    /// Checks what its encoder of instructions needs, without loading it.
    ///
    /// # Errors
    /// If the encoder's weights are not there or have other shapes.
    pub fn check_text_encoder(&self) -> Result<(), CheckpointError> {
        let language = self.description.language.as_ref();
        language.map_or(Ok(()), |language| TextEncoder::check(language, &self.folder))
    }

    /// The encoder of instructions that it was trained with, for a network that sees instructions.
    ///
    /// # Errors
    /// If the encoder's weights cannot be loaded or are not those of the training.
    pub fn text_encoder(&self) -> Result<Option<TextEncoder>, CheckpointError> {
        self.description
            .language
            .as_ref()
            .map(|language| TextEncoder::open(language, &self.folder))
            .transpose()
    }

    /// Reads what inference needs.
    ///
    /// # Errors
    /// If the file cannot be read to the end.
    pub fn weights(&mut self) -> Result<Weights, CheckpointError> {
        let mut weights = Weights::default();
        for spec in tensor_specs(&self.description.architecture) {
            let numbers = self.tensors.read(&self.description.naming.stored(&spec.name))?;
            weights.insert(spec.name, numbers);
        }
        Ok(weights)
    }

    fn check_tensors(&self) -> Result<(), CheckpointError> {
        let naming = &self.description.naming;
        let mut known = std::collections::BTreeSet::new();
        for spec in tensor_specs(&self.description.architecture) {
            let stored = naming.stored(&spec.name);
            self.tensors.check(&stored, &spec.shape)?;
            known.insert(stored);
        }
        let unused = |name: &str| {
            name.ends_with(IGNORED_SUFFIX) || naming.unused.iter().any(|prefix| name.starts_with(prefix))
        };
        let unknown = self.tensors.names().into_iter().find(|name| !known.contains(name) && !unused(name));
        unknown.map_or(Ok(()), |tensor| {
            let found = self.tensors.describe(&tensor).unwrap_or_default();
            Err(CheckpointError::Unknown { path: self.tensors.path().to_owned(), tensor, found })
        })
    }
}

impl Naming {
    /// The name under which a tensor is stored.
    fn stored(&self, name: &str) -> String {
        let renamed = self
            .prefixes
            .iter()
            .find_map(|(from, to)| name.strip_prefix(from).map(|rest| format!("{to}{rest}")));
        renamed.unwrap_or_else(|| name.to_owned())
    }
}

fn parse<'a, T: Deserialize<'a>>(path: &Path, text: &'a [u8]) -> Result<T, CheckpointError> {
    serde_json::from_slice(text).map_err(|source| CheckpointError::Json { path: path.to_owned(), source })
}
