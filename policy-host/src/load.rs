//! Construction of a [`Policy`] from a [`PolicySpec`].

use ipc_types::{ControlMode, ImageSizes, Morphology};
use run_config::{DeviceChoice, QueryOptions};
use thiserror::Error;

use crate::QueryMode;
use crate::device::{DeviceError, DeviceRequest};
use crate::formats::{CheckpointFolderError, PolicyCheck};
#[cfg(feature = "gpu")]
use crate::models::LoadGpuError;
use crate::models::family::{NetworkFamily, NetworkSource};
use crate::models::idle::IdlePolicy;
use crate::models::random::RandomPolicy;
use crate::nn::Precision;
use crate::policy::Policy;
use crate::policy::ensemble::Ensemble;
use crate::spec::PolicySpec;

/// Errors that can occur while loading a policy or checking it against a run.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum LoadError {
    #[error("policy `{spec}` does not run in a policy host")]
    NotHosted { spec: PolicySpec },
    #[error(transparent)]
    Folder(#[from] CheckpointFolderError),
    #[error(transparent)]
    Device(#[from] DeviceError),
}

/// Like [`load_on`], on the CPU and for images of the benchmark's sizes.
///
/// # Errors
/// If the policy does not run in a policy host, or its checkpoint cannot be loaded.
pub fn load(
    spec: &PolicySpec,
    n_threads: usize,
    mode: QueryMode,
    robots: &[Morphology],
) -> Result<Box<dyn Policy>, LoadError> {
    load_on(spec, DeviceChoice::Cpu.into(), n_threads, mode, (robots, ImageSizes::BENCHMARK))
}

/// Loads a policy. Of a checkpoint with a network for each robot, only the networks of `robots` are loaded,
/// for images of these sizes.
/// The policy uses up to `n_threads` threads of the rayon pool in which it is called. Policies without a
/// network compute on the CPU, and so do all with [`DeviceChoice::Auto`], which
/// [`device::find`](crate::device::find) resolves.
///
/// # Errors
/// If the policy does not run in a policy host, its checkpoint cannot be loaded, or the device not opened.
pub fn load_on(
    spec: &PolicySpec,
    device: DeviceRequest,
    n_threads: usize,
    mode: QueryMode,
    (robots, images): (&[Morphology], ImageSizes),
) -> Result<Box<dyn Policy>, LoadError> {
    let policy: Box<dyn Policy> = match spec {
        PolicySpec::Idle => Box::new(IdlePolicy),
        PolicySpec::Random => Box::new(RandomPolicy),
        PolicySpec::Network(family, source) => {
            load_network(family.definition(), source, device, n_threads, (robots, images))?
        }
        PolicySpec::Expert | PolicySpec::Attach(_) | PolicySpec::Server(_) => {
            return Err(LoadError::NotHosted { spec: spec.clone() });
        }
    };
    Ok(match mode {
        QueryMode::Chunk => policy,
        QueryMode::Ensemble => Box::new(Ensemble::new(policy)),
    })
}

/// Checks that a policy can drive these robots in these control modes, without loading it. For a checkpoint,
/// this reads the configuration and the header of the weights file, and resolves the use of its chunks.
///
/// # Errors
/// The first mismatch found.
pub fn check(
    spec: &PolicySpec,
    robots: &[(Morphology, ControlMode)],
    requested: QueryOptions,
) -> Result<PolicyCheck, LoadError> {
    match spec {
        PolicySpec::Network(family, source) => Ok((family.definition().check)(source, robots, requested)?),
        _ => Ok(PolicyCheck::default()),
    }
}

/// Returns sentences about instructions, each with its robot, that are too long for a policy, which cuts them
/// off.
///
/// # Errors
/// If its checkpoint cannot be read.
pub fn long_prompts(
    spec: &PolicySpec,
    instructions: &[(Morphology, String)],
) -> Result<Vec<String>, LoadError> {
    match spec {
        PolicySpec::Network(family, source) => {
            Ok((family.definition().long_prompts)(&source.folder, instructions)?)
        }
        _ => Ok(Vec::new()),
    }
}

fn load_network(
    family: &NetworkFamily,
    source: &NetworkSource,
    device: DeviceRequest,
    n_threads: usize,
    (robots, images): (&[Morphology], ImageSizes),
) -> Result<Box<dyn Policy>, LoadError> {
    let on_cpu = matches!(device.choice, DeviceChoice::Auto | DeviceChoice::Cpu);
    if on_cpu || source.precision != Precision::F32 {
        Ok((family.load)(source, n_threads, robots, images)?)
    } else {
        load_on_gpu(family, source, device, (robots, images))
    }
}

#[cfg(feature = "gpu")]
fn load_on_gpu(
    family: &NetworkFamily,
    source: &NetworkSource,
    device: DeviceRequest,
    (robots, images): (&[Morphology], ImageSizes),
) -> Result<Box<dyn Policy>, LoadError> {
    let (kind, index) = device.adapter();
    let gpu = crate::nn::gpu::open(kind, index).map_err(LoadGpuError::from)?;
    Ok((family.load_on_gpu)(source, gpu, robots, images)?)
}

#[cfg(not(feature = "gpu"))]
fn load_on_gpu(
    _: &NetworkFamily,
    _: &NetworkSource,
    _: DeviceRequest,
    _: (&[Morphology], ImageSizes),
) -> Result<Box<dyn Policy>, LoadError> {
    Err(DeviceError::NotBuilt.into())
}

#[cfg(feature = "gpu")]
impl From<LoadGpuError> for LoadError {
    fn from(error: LoadGpuError) -> Self {
        use crate::nn::gpu::GpuError;
        match error {
            LoadGpuError::Folder(error) => error.into(),
            LoadGpuError::Device(error @ GpuError::Device { .. }) => {
                DeviceError::Failed { reason: error.to_string() }.into()
            }
            LoadGpuError::Device(error) => DeviceError::Unusable { reason: error.to_string() }.into(),
        }
    }
}
