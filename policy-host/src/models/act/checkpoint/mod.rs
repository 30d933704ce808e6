//! ACT checkpoint folders, in two formats, the benchmark's and LeRobot's, with their common description.
//!
//! A folder contains `config.json`, whose `type` selects the format, and `model.safetensors`; LeRobot's
//! folders also contain the pre- and postprocessor. Every tensor is checked by name, dtype and shape before
//! any is read.

pub mod colosseum;
pub mod tensors;

mod description;
mod lerobot;
mod stored;

use std::path::{Path, PathBuf};

use run_config::input;

use self::description::ActDescription;
pub(crate) use self::stored::{StoredNetwork, load_networks, open_all};
use self::tensors::tensor_specs;
use super::architecture::{Architecture, InvalidHyperparameter, Normalisation};
use crate::formats::settings::Settings;
use crate::formats::{CheckpointError, ObservationMapping};
use crate::policy::execution::ChunkSettings;
use crate::text::TextEncoder;
use crate::weights::{CONFIG_FILE, MODEL_FILE, StateDict, TensorFile};

/// A checkpoint whose configuration and weights header have been checked against each other.
#[derive(Debug)]
pub struct ActCheckpoint {
    folder: PathBuf,
    description: ActDescription,
    tensors: TensorFile,
}

/// Suffix of the batch counters of PyTorch's BatchNorm, which are accepted with any dtype and ignored.
const IGNORED_SUFFIX: &str = ".num_batches_tracked";

impl ActCheckpoint {
    /// Reads the configuration in `folder` and the header of its weights file, and checks one against the
    /// other.
    ///
    /// # Errors
    /// The first mismatch found, with file, tensor, actual and expected value.
    pub fn open(folder: &Path) -> Result<Self, CheckpointError> {
        let path = folder.join(CONFIG_FILE);
        let text =
            input::read(&path).map_err(|source| CheckpointError::Read { path: path.clone(), source })?;
        let mut settings = Settings::parse(&path, &text)?;
        let expected = "`act_colosseum` or LeRobot's `act`";
        let format: String = settings.require("type", expected)?;
        let mut tensors = None;
        let description = match format.as_str() {
            "act_colosseum" => colosseum::describe(&path, &text, &mut tensors),
            "act" => lerobot::describe(folder, settings, &mut tensors),
            _ => Err(CheckpointError::format(path.clone(), &format, expected)),
        }?;
        description.architecture.check().map_err(|InvalidHyperparameter { name, found, expected }| {
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

    /// Returns the architecture of the network.
    #[must_use]
    pub fn architecture(&self) -> &Architecture {
        &self.description.architecture
    }

    /// Returns the normalisation of the network's inputs and outputs.
    #[must_use]
    pub fn normalisation(&self) -> &Normalisation {
        &self.description.normalisation
    }

    /// Returns the mapping from the robot's observation to the network's input.
    ///
    /// # Errors
    /// If the two do not fit together; the message lists both sides.
    pub fn mapping(&self) -> Result<&ObservationMapping, CheckpointError> {
        self.description.mapping.as_ref().map_err(|reason| CheckpointError::Mapping {
            path: self.folder.join(CONFIG_FILE),
            reason: reason.clone(),
        })
    }

    /// Returns what the checkpoint says about the use of its chunks.
    #[must_use]
    pub fn chunk_settings(&self) -> ChunkSettings {
        self.description.chunk
    }

    /// Returns what the user should know about its settings, one sentence each.
    #[must_use]
    pub fn notes(&self) -> &[String] {
        &self.description.notes
    }

    /// Checks the files of the language encoder without loading them.
    ///
    /// # Errors
    /// If the encoder's weights are missing or have different shapes.
    pub fn check_text_encoder(&self) -> Result<(), CheckpointError> {
        let language = self.description.language.as_ref();
        language.map_or(Ok(()), |language| Ok(TextEncoder::check(language, &self.folder)?))
    }

    /// Loads the language encoder of the training run, or returns `None` for a network without instruction
    /// input.
    ///
    /// # Errors
    /// If the encoder's weights cannot be loaded or are not the ones used for training.
    pub fn text_encoder(&self) -> Result<Option<TextEncoder>, CheckpointError> {
        let language = self.description.language.as_ref();
        Ok(language.map(|language| TextEncoder::open(language, &self.folder)).transpose()?)
    }

    /// Reads all tensors that inference needs, under the benchmark's names.
    ///
    /// # Errors
    /// If a tensor cannot be read.
    pub fn state_dict(&mut self) -> Result<StateDict, CheckpointError> {
        self.check_values()?;
        let mut state_dict = StateDict::default();
        for spec in tensor_specs(&self.description.architecture) {
            let values = self.tensors.read(&self.description.names.stored(&spec.name))?;
            state_dict.insert(spec.name, values);
        }
        Ok(state_dict)
    }

    /// Checks that all weights are finite, also those that only training uses, and that variances are ones.
    ///
    /// # Errors
    /// The first tensor of which this is not true, or an error of reading.
    pub fn check_values(&mut self) -> Result<(), CheckpointError> {
        for tensor in self.tensors.names().into_iter().filter(|name| !name.ends_with(IGNORED_SUFFIX)) {
            let values = self.tensors.read(&tensor)?;
            let path = || self.tensors.path().to_owned();
            if values.iter().any(|x| !x.is_finite()) {
                return Err(CheckpointError::NotFinite { path: path(), tensor });
            }
            let negative = values.into_iter().find(|x| tensor.ends_with("running_var") && *x < 0.0);
            if let Some(found) = negative {
                return Err(CheckpointError::NegativeVariance { path: path(), tensor, found });
            }
        }
        Ok(())
    }

    fn check_tensors(&self) -> Result<(), CheckpointError> {
        let names = &self.description.names;
        let mut known = std::collections::BTreeSet::new();
        for spec in tensor_specs(&self.description.architecture) {
            let stored = names.stored(&spec.name);
            self.tensors.check(&stored, &spec.shape)?;
            known.insert(stored);
        }
        let unused = |name: &str| {
            name.ends_with(IGNORED_SUFFIX) || names.unused.iter().any(|prefix| name.starts_with(prefix))
        };
        let unexpected = self.tensors.names().into_iter().find(|name| !known.contains(name) && !unused(name));
        unexpected.map_or(Ok(()), |tensor| {
            let found = self.tensors.describe(&tensor).unwrap_or_default();
            let path = self.tensors.path().to_owned();
            Err(CheckpointError::UnexpectedTensor { path, tensor, found })
        })
    }
}
