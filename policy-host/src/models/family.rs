//! The definition of a family of networks, which each family's folder fills in.

use std::num::NonZeroU32;
use std::path::{Path, PathBuf};

use ipc_types::{ControlMode, ImageSizes, Morphology};
use run_config::QueryOptions;
use serde::{Deserialize, Serialize};

#[cfg(feature = "gpu")]
use super::LoadGpuError;
use crate::formats::{CheckpointFolderError, PolicyCheck};
use crate::nn::Precision;
#[cfg(feature = "gpu")]
use crate::nn::gpu::GpuDevice;
use crate::policy::Policy;

/// A checkpoint as a user names it: its folder, and options.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NetworkSource {
    /// Checkpoint folder.
    pub folder: PathBuf,
    /// Precision in which the network is evaluated.
    pub precision: Precision,
    /// Number of Euler steps from noise to actions, if not the checkpoint's own.
    pub n_steps: Option<NonZeroU32>,
}

/// Everything that the rest of the program knows of a family of networks.
#[derive(Debug)]
pub struct NetworkFamily {
    /// Name on the command line.
    pub name: &'static str,
    /// Precisions in which it can be evaluated. On a GPU there is only [`Precision::F32`].
    pub precisions: &'static [Precision],
    /// Maximum of the option `?steps=N`, if the family has it.
    pub max_steps: Option<u32>,
    /// `true` if a policy reads weights where they lie in their files, for as long as it lives.
    pub maps_weights: bool,
    /// Seconds that a batch may take, if it may take unusually long.
    pub answer_timeout_s: Option<u32>,
    pub(crate) check: CheckFn,
    pub(crate) long_prompts: LongPromptsFn,
    pub(crate) load: LoadFn,
    #[cfg(feature = "gpu")]
    pub(crate) load_on_gpu: LoadOnGpuFn,
}

/// Checks a checkpoint against the robots of a run and their control modes, without loading it, and resolves
/// how its chunks are executed.
pub(crate) type CheckFn = fn(
    &NetworkSource,
    &[(Morphology, ControlMode)],
    QueryOptions,
) -> Result<PolicyCheck, CheckpointFolderError>;

/// Returns sentences about instructions, each with its robot, that the networks in a folder cut off.
pub(crate) type LongPromptsFn =
    fn(&Path, &[(Morphology, String)]) -> Result<Vec<String>, CheckpointFolderError>;

/// Loads the networks for some robots, for up to a number of threads and images of some sizes.
pub(crate) type LoadFn =
    fn(&NetworkSource, usize, &[Morphology], ImageSizes) -> Result<Box<dyn Policy>, CheckpointFolderError>;

/// Loads the networks for some robots onto a device, for images of some sizes.
#[cfg(feature = "gpu")]
pub(crate) type LoadOnGpuFn =
    fn(&NetworkSource, GpuDevice, &[Morphology], ImageSizes) -> Result<Box<dyn Policy>, LoadGpuError>;
