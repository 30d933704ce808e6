//! Description of a π0.5 checkpoint, which both of its formats produce, and the parts of the folder from
//! which they produce it.

use std::fmt;
use std::path::{Path, PathBuf};

use super::names::Pi05Names;
use crate::formats::CheckpointError;
use crate::formats::files::MAPPING_FILE;
use crate::formats::lerobot::feature::InputFeature;
use crate::formats::mapping::{ObservationMapping, PromptState, Sidecar, map_features};
use crate::formats::scaling::Scaling;
use crate::models::pi05::architecture::{DEFAULT_VISION_HEADS, Pi05Architecture};
use crate::policy::execution::ChunkSettings;
use crate::weights::{CONFIG_FILE, TensorFolder};

/// Contents of a folder's configuration, independent of its format.
#[derive(Clone, Debug)]
pub struct Pi05Description {
    /// Sizes of the network.
    pub architecture: Pi05Architecture,
    /// Mapping from the robot's observation to the network's input. Cameras are in the network's order,
    /// without those that the robot does not have.
    pub mapping: ObservationMapping,
    /// Scaling of the robot's state.
    pub state: Scaling,
    /// Scaling of the robot's actions, applied in reverse.
    pub action: Scaling,
    /// Number of entries of the robot's action.
    pub action_dim: usize,
    /// Marks of the entries of an action that are relative to those of the network's state with the same
    /// index, or an empty vector if none is.
    pub relative: Vec<bool>,
    /// State numbers in the prompt.
    pub prompt_state: PromptState,
    /// Value of the letterbox padding of images that are not square.
    pub padding_value: f32,
    /// Number of entries to which the state is padded, if it is.
    pub max_state_dim: usize,
    /// Folder of the vocabulary.
    pub tokenizer_folder: PathBuf,
    /// Maximum number of tokens of a prompt; a longer one is cut off, as in LeRobot.
    pub max_tokens: usize,
    /// Number of Euler steps from noise to actions, unless the user chooses another.
    pub n_steps: usize,
    /// Shortest and longest period of the time embedding.
    pub periods: (f64, f64),
    /// Use of its chunks.
    pub chunk: ChunkSettings,
    /// Sentences for the user about its settings.
    pub notes: Vec<String>,
}

/// The parts of a checkpoint folder that are read before its configuration.
pub(crate) struct Folder<'a> {
    pub(crate) folder: &'a Path,
    pub(crate) tensors: &'a TensorFolder,
    pub(crate) names: &'a Pi05Names,
    pub(crate) sidecar: &'a Sidecar,
}

impl Pi05Description {
    /// Returns the network's part of a robot's state vector.
    pub(crate) fn state_of(&self, state: &[f32]) -> Vec<f32> {
        self.mapping.state.iter().flat_map(|part| &state[part.clone()]).copied().collect()
    }

    /// Returns the number of state numbers in a prompt.
    #[must_use]
    pub fn n_prompt_numbers(&self) -> usize {
        match self.prompt_state {
            PromptState::Unpadded => self.mapping.state.iter().map(ExactSizeIterator::len).sum(),
            PromptState::Padded => self.max_state_dim,
        }
    }
}

impl Folder<'_> {
    pub(crate) fn value(
        &self,
        key: &str,
        found: impl fmt::Display,
        expected: impl fmt::Display,
    ) -> CheckpointError {
        CheckpointError::Value {
            path: self.folder.join(CONFIG_FILE),
            key: key.to_owned(),
            found: found.to_string(),
            expected: expected.to_string(),
        }
    }

    pub(crate) fn architecture(&self, horizon: usize) -> Result<Pi05Architecture, CheckpointError> {
        let n_heads = self.sidecar.vision_heads.unwrap_or(DEFAULT_VISION_HEADS);
        let architecture = Pi05Architecture::of(self.tensors, self.names, n_heads, horizon)?;
        match architecture.invalid() {
            None => Ok(architecture),
            Some((key, found, expected)) => Err(self.value(key, found, expected)),
        }
    }

    /// Maps the robot's observation to the network's features, cameras in their order.
    pub(crate) fn mapping(
        &self,
        features: Vec<InputFeature>,
        action_dim: usize,
    ) -> Result<ObservationMapping, CheckpointError> {
        let path = self.folder.join(MAPPING_FILE);
        let present: Vec<_> =
            features.into_iter().filter(|feature| !self.sidecar.leaves_out(feature)).collect();
        map_features(&present, action_dim, self.sidecar)
            .map_err(|reason| CheckpointError::Mapping { path, reason })
    }
}
