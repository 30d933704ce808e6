//! Construction of a [`Policy`] from a [`PolicySpec`]: the only module that lists the implementors.

use std::path::Path;

use ipc_types::{ControlMode, Morphology};
use run_config::{DeviceChoice, QueryOptions};
use thiserror::Error;

use crate::QueryMode;
use crate::act::{self, ActPolicy};
use crate::checkpoint::CheckpointFolderError;
#[cfg(feature = "gpu")]
use crate::checkpoint::LoadGpuError;
use crate::device::{DeviceError, DeviceRequest};
use crate::ensemble::Ensemble;
use crate::idle::IdlePolicy;
use crate::nn::Precision;
use crate::pi05::{self, Pi05Policy};
use crate::policy::{Policy, PolicyCheck};
use crate::random::RandomPolicy;
use crate::spec::{Pi05Source, PolicySpec};

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

/// Like [`load_on`], on the CPU.
///
/// # Errors
/// If the policy does not run in a policy host, or its checkpoint cannot be loaded.
pub fn load(
    spec: &PolicySpec,
    n_threads: usize,
    mode: QueryMode,
    robots: &[Morphology],
) -> Result<Box<dyn Policy>, LoadError> {
    load_on(spec, DeviceChoice::Cpu.into(), n_threads, mode, robots)
}

/// Loads a policy for these robots, of whose networks only those are read. It uses up to `n_threads` threads
/// of the rayon pool in which it is called. Policies that support no GPU compute on the CPU; so do the others
/// with [`DeviceChoice::Auto`], which [`device::find`](crate::device::find) resolves.
///
/// # Errors
/// If the policy does not run in a policy host, its checkpoint cannot be loaded, or the device not opened.
pub fn load_on(
    spec: &PolicySpec,
    device: DeviceRequest,
    n_threads: usize,
    mode: QueryMode,
    robots: &[Morphology],
) -> Result<Box<dyn Policy>, LoadError> {
    let policy: Box<dyn Policy> = match spec {
        PolicySpec::Idle => Box::new(IdlePolicy),
        PolicySpec::Random => Box::new(RandomPolicy),
        PolicySpec::Act(folder) => match device.choice {
            DeviceChoice::Auto | DeviceChoice::Cpu => {
                Box::new(ActPolicy::load(folder, Precision::F32, n_threads, robots)?)
            }
            DeviceChoice::Gpu | DeviceChoice::Software => load_act_on_gpu(folder, device, robots)?,
        },
        PolicySpec::ActInt8(folder) => Box::new(ActPolicy::load(folder, Precision::Int8, n_threads, robots)?),
        PolicySpec::Pi05(source) => match device.choice {
            DeviceChoice::Auto | DeviceChoice::Cpu => Box::new(load_pi05(source, Precision::F32, robots)?),
            DeviceChoice::Gpu | DeviceChoice::Software => load_pi05_on_gpu(source, device, robots)?,
        },
        PolicySpec::Pi05Int8(source) => Box::new(load_pi05(source, Precision::Int8, robots)?),
        PolicySpec::Expert | PolicySpec::Attach(_) => {
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
        PolicySpec::Idle | PolicySpec::Random | PolicySpec::Expert | PolicySpec::Attach(_) => {
            Ok(PolicyCheck::default())
        }
        PolicySpec::Act(folder) | PolicySpec::ActInt8(folder) => Ok(act::check(folder, robots, requested)?),
        PolicySpec::Pi05(source) => Ok(pi05::check(&source.folder, Precision::F32, robots, requested)?),
        PolicySpec::Pi05Int8(source) => Ok(pi05::check(&source.folder, Precision::Int8, robots, requested)?),
    }
}

/// Returns sentences about instructions, each with its robot, that a policy does not read to their end.
///
/// # Errors
/// If its checkpoint cannot be read.
pub fn long_prompts(
    spec: &PolicySpec,
    instructions: &[(Morphology, String)],
) -> Result<Vec<String>, LoadError> {
    match spec {
        PolicySpec::Pi05(source) | PolicySpec::Pi05Int8(source) => {
            Ok(pi05::long_prompts(&source.folder, instructions)?)
        }
        _ => Ok(Vec::new()),
    }
}

#[cfg(feature = "gpu")]
fn load_act_on_gpu(
    folder: &Path,
    device: DeviceRequest,
    robots: &[Morphology],
) -> Result<Box<dyn Policy>, LoadError> {
    Ok(Box::new(act::GpuActPolicy::load(open(device)?, folder, robots)?))
}

#[cfg(feature = "gpu")]
fn load_pi05_on_gpu(
    source: &Pi05Source,
    device: DeviceRequest,
    robots: &[Morphology],
) -> Result<Box<dyn Policy>, LoadError> {
    let n_steps = source.n_steps.map(|steps| steps.get() as usize);
    Ok(Box::new(pi05::GpuPi05Policy::load(open(device)?, &source.folder, n_steps, robots)?))
}

#[cfg(feature = "gpu")]
fn open(device: DeviceRequest) -> Result<crate::nn::gpu::GpuDevice, LoadGpuError> {
    let (kind, index) = device.adapter();
    Ok(crate::nn::gpu::open(kind, index)?)
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

#[cfg(not(feature = "gpu"))]
fn load_act_on_gpu(_: &Path, _: DeviceRequest, _: &[Morphology]) -> Result<Box<dyn Policy>, LoadError> {
    Err(DeviceError::NotBuilt.into())
}

#[cfg(not(feature = "gpu"))]
fn load_pi05_on_gpu(
    _: &Pi05Source,
    _: DeviceRequest,
    _: &[Morphology],
) -> Result<Box<dyn Policy>, LoadError> {
    Err(DeviceError::NotBuilt.into())
}

fn load_pi05(
    source: &Pi05Source,
    precision: Precision,
    robots: &[Morphology],
) -> Result<Pi05Policy, CheckpointFolderError> {
    let n_steps = source.n_steps.map(|steps| steps.get() as usize);
    Pi05Policy::load(&source.folder, precision, n_steps, robots)
}
