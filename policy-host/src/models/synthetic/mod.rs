//! Checkpoints with generated instead of trained weights, for tests, benchmarks and first trials.
//!
//! Element `i` (row-major) of a tensor is drawn from the stream named after the tensor
//! ([`crate::generated`]). The ranges keep activations bounded in networks of any depth:
//!
//! | tensor | range |
//! |--|--|
//! | running variance of a batch normalisation | 0.5 to 1.5 |
//! | running mean of a batch normalisation | ±0.1 |
//! | learned embeddings (two axes, name contains `embed`) | ±1 |
//! | scales (one axis, name ends in `weight`) | 0.9 to 1.1 |
//! | other tensors with one axis | ±0.05 |
//! | all other tensors | ±√(3 / fan-in) |
//!
//! Seed 0 uses the streams unchanged, so that other implementations can reproduce it; another seed shifts
//! every stream.

mod pi05;

use std::io;
use std::path::{Path, PathBuf};

use ipc_types::ImageSizes;
use safetensors::tensor::{Dtype, TensorView};
use thiserror::Error;

pub use self::pi05::{pi05_bytes, write_pi05_checkpoint};
use super::act::ActPolicy;
use super::act::architecture::{Architecture, InvalidHyperparameter};
use super::act::checkpoint::colosseum::ActConfig;
use super::act::checkpoint::tensors::tensor_specs;
use super::act::model::ActModel;
use crate::generated::{fnv1a64, splitmix64, sym};
use crate::nn::Precision;
use crate::text::TextEncoder;
use crate::weights::{CONFIG_FILE, MODEL_FILE, StateDict, TensorSpec};

/// Errors that can occur while writing a checkpoint.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum WriteCheckpointError {
    #[error("the {name} is {found}, expected {expected}")]
    Value { name: &'static str, found: usize, expected: String },
    #[error("failed to write {}", path.display())]
    Io { path: PathBuf, source: io::Error },
    #[error("failed to write {}", path.display())]
    Tensors { path: PathBuf, source: safetensors::SafeTensorError },
    #[error("failed to write {}", path.display())]
    Json { path: PathBuf, source: serde_json::Error },
}

/// Returns generated values for all tensors of a network.
#[must_use]
pub fn state_dict(architecture: &Architecture, seed: u64) -> StateDict {
    let mut state_dict = StateDict::default();
    for spec in tensor_specs(architecture) {
        let values = tensor(&spec, seed);
        state_dict.insert(spec.name, values);
    }
    state_dict
}

/// Returns the policy whose checkpoint [`write_checkpoint`] would write, for up to `n_threads` threads.
///
/// # Panics
/// If the configuration names no robot, or a language encoder that needs weights.
#[must_use]
pub fn policy(config: &ActConfig, seed: u64, precision: Precision, n_threads: usize) -> ActPolicy {
    let architecture = config.architecture();
    let state_dict = state_dict(&architecture, seed);
    let model = ActModel::new(
        architecture,
        config.raw_normalisation(),
        &state_dict,
        precision,
        &ImageSizes::BENCHMARK.all(),
    );
    let encoder = config.language.as_ref().map(|language| {
        TextEncoder::open(language, Path::new(""))
            .expect("a synthetic checkpoint uses an encoder without files")
    });
    ActPolicy::new(model, config.mapping().expect("a synthetic checkpoint names a robot"), encoder, n_threads)
}

/// Writes a checkpoint with generated weights to `folder`, creating it if necessary: `config.json`, and
/// `model.safetensors` with the tensors that inference needs.
///
/// # Errors
/// If a hyperparameter is invalid, or a file cannot be written.
pub fn write_checkpoint(folder: &Path, config: &ActConfig, seed: u64) -> Result<(), WriteCheckpointError> {
    let architecture = config.architecture();
    architecture.check().map_err(|InvalidHyperparameter { name, found, expected }| {
        WriteCheckpointError::Value { name, found, expected }
    })?;
    let at = |path: &Path| {
        let path = path.to_owned();
        |source| WriteCheckpointError::Io { path, source }
    };
    std::fs::create_dir_all(folder).map_err(at(folder))?;
    let path = folder.join(CONFIG_FILE);
    let json = serde_json::to_string_pretty(config)
        .map_err(|source| WriteCheckpointError::Json { path: path.clone(), source })?;
    std::fs::write(&path, json + "\n").map_err(at(&path))?;

    let path = folder.join(MODEL_FILE);
    let tensors = |source| WriteCheckpointError::Tensors { path: path.clone(), source };
    let specs = tensor_specs(&architecture);
    let bytes: Vec<Vec<u8>> = specs
        .iter()
        .map(|spec| tensor(spec, seed).into_iter().flat_map(f32::to_le_bytes).collect())
        .collect();
    let views = specs.iter().zip(&bytes).map(|(spec, bytes)| {
        TensorView::new(Dtype::F32, spec.shape.clone(), bytes).map(|view| (spec.name.as_str(), view))
    });
    let views: Vec<_> = views.collect::<Result<_, _>>().map_err(tensors)?;
    safetensors::serialize_to_file(views, None, &path).map_err(tensors)
}

/// Returns the generated values of a tensor, row-major.
#[must_use]
pub fn tensor(spec: &TensorSpec, seed: u64) -> Vec<f32> {
    let rule = element(spec, seed, false);
    (0..spec.shape.iter().product()).map(rule).collect()
}

/// Returns the rule for the elements of a tensor. Scales are centred at 0 instead of 1 if the network adds
/// one to them.
fn element(spec: &TensorSpec, seed: u64, adds_one: bool) -> impl Fn(usize) -> f32 + Sync + use<> {
    let shift = if seed == 0 { 0 } else { splitmix64(seed) };
    let stream = fnv1a64(&spec.name) ^ shift;
    let fan_in: usize = spec.shape[1..].iter().product();
    let one_axis = spec.shape.len() == 1;
    let (centre, bound) = if spec.name.ends_with("running_var") {
        (1.0, 0.5)
    } else if spec.name.ends_with("running_mean") {
        (0.0, 0.1)
    } else if spec.shape.len() == 2 && spec.name.contains("embed") {
        (0.0, 1.0)
    } else if one_axis && spec.name.ends_with("weight") {
        (if adds_one { 0.0 } else { 1.0 }, 0.1)
    } else if one_axis {
        (0.0, 0.05)
    } else {
        (0.0, (3.0 / fan_in as f32).sqrt())
    };
    move |idx| centre + sym(stream, idx, bound)
}
