//! The π0.5 policy: maps observations to the network's input, and its output to actions.

use std::collections::HashMap;
use std::path::Path;
#[cfg(feature = "gpu")]
use std::sync::Arc;

use ipc_types::{ControlMode, Morphology, ObservationView};
use rayon::prelude::*;
use xxhash_rust::xxh3::xxh3_64;

#[cfg(feature = "gpu")]
use super::gpu::GpuPi05Network;
use super::image::resize_with_pad;
use super::model::{Pi05Input, Pi05Model, SampleTokens};
use super::prompt::{PromptState, Prompter, TokenizerError, prompt};
use super::sampler::draw_noise;
#[cfg(feature = "gpu")]
use crate::act::LoadGpuError;
use crate::act::architecture::ImageSize;
use crate::checkpoint::pi05::{Pi05Checkpoint, Pi05Description, is_pi05_folder};
use crate::checkpoint::{CheckpointFolderError, check_robots, checkpoint_folders};
use crate::nn::Precision;
#[cfg(feature = "gpu")]
use crate::nn::gpu::GpuDevice;
use crate::policy::{ActionChunk, Policy, PolicyError, Stopwatch};

/// Samples that are computed together, and read the weights once. It bounds the memory of a batch.
const SAMPLES_PER_BATCH: usize = 8;
/// Tokens of a typical prompt, for an estimate of the time that a query takes.
const TYPICAL_PROMPT: usize = 60;
/// Operations of a query from which on the time that it takes is announced.
const MIN_ANNOUNCED_FLOP: u64 = 100_000_000_000;

/// π0.5 with one network per morphology in its checkpoint folder, on the CPU or on a GPU.
#[derive(Debug)]
pub struct Pi05Policy {
    networks: Vec<Pi05Network>,
    precision: Precision,
}

/// The network for one morphology.
#[derive(Debug)]
struct Pi05Network {
    engine: Pi05Engine,
    prompter: Prompter,
    description: Pi05Description,
    /// Number of Euler steps from noise to actions.
    n_steps: usize,
}

/// The network on its device.
#[derive(Debug)]
enum Pi05Engine {
    Cpu(Box<Pi05Model>),
    #[cfg(feature = "gpu")]
    Gpu(Box<GpuPi05Network>),
}

/// The distinct images of a batch, found by content: an image that several envs see is encoded once.
#[derive(Debug, Default)]
struct DistinctImages<'a> {
    images: Vec<(&'a [u8], usize)>,
    by_hash: HashMap<u64, Vec<usize>>,
}

/// Checks the configuration, the weights headers and the vocabulary of a checkpoint against the robots of a
/// run and their control modes, and the size of the weights against the memory that is available. Loads no
/// weights.
///
/// # Errors
/// The first mismatch found.
pub fn check(
    folder: &Path,
    precision: Precision,
    robots: &[(Morphology, ControlMode)],
) -> Result<(), CheckpointFolderError> {
    let mut found = Vec::new();
    for checkpoint in open(folder)? {
        let mapping = &checkpoint.description().mapping;
        found.push((mapping.morphology, mapping.control_mode));
        checkpoint.prompter()?;
        checkpoint.check_memory(precision)?;
    }
    check_robots(folder, &found, robots)
}

fn open(folder: &Path) -> Result<Vec<Pi05Checkpoint>, CheckpointFolderError> {
    let folders = checkpoint_folders(folder, "a configuration or weights", is_pi05_folder)?;
    Ok(folders.iter().map(|folder| Pi05Checkpoint::open(folder)).collect::<Result<_, _>>()?)
}

/// Opens the checkpoints in a folder for these robots and loads each with `load(checkpoint, n_steps)`.
fn load_networks<E: From<CheckpointFolderError>>(
    folder: &Path,
    n_steps: Option<usize>,
    robots: &[Morphology],
    load: impl Fn(&Pi05Checkpoint, usize) -> Result<Pi05Engine, E>,
) -> Result<Vec<Pi05Network>, E> {
    let mut networks: Vec<Pi05Network> = Vec::new();
    for checkpoint in open(folder)? {
        let description = checkpoint.description().clone();
        let morphology = description.mapping.morphology;
        if !robots.contains(&morphology) {
            continue;
        }
        if networks.iter().any(|network| network.description.mapping.morphology == morphology) {
            let (folder, morphology) = (folder.to_owned(), morphology.name());
            return Err(CheckpointFolderError::DuplicateMorphology { folder, morphology }.into());
        }
        let prompter = checkpoint.prompter().map_err(CheckpointFolderError::from)?;
        let n_steps = n_steps.unwrap_or(description.n_steps);
        let engine = load(&checkpoint, n_steps)?;
        networks.push(Pi05Network { engine, prompter, description, n_steps });
    }
    Ok(networks)
}

impl Pi05Policy {
    /// Loads the networks for `robots` in `folder`. `n_steps` is the number of Euler steps from noise to
    /// actions; the checkpoint's own by default.
    ///
    /// # Errors
    /// The first file or tensor that is missing, unexpected or damaged.
    pub fn load(
        folder: &Path,
        precision: Precision,
        n_steps: Option<usize>,
        robots: &[Morphology],
    ) -> Result<Self, CheckpointFolderError> {
        let networks = load_networks(folder, n_steps, robots, |checkpoint, n_steps| {
            checkpoint.check_memory(precision)?;
            let model = checkpoint.load(precision, n_steps)?;
            Ok::<_, CheckpointFolderError>(Pi05Engine::Cpu(Box::new(model)))
        })?;
        Ok(Self { networks, precision })
    }

    /// Like [`load`](Self::load), onto a device, with weights as stored.
    ///
    /// # Errors
    /// The first file or tensor that is missing, unexpected or damaged, or the failure of the device.
    #[cfg(feature = "gpu")]
    pub fn load_on_gpu(
        gpu: GpuDevice,
        folder: &Path,
        n_steps: Option<usize>,
        robots: &[Morphology],
    ) -> Result<Self, LoadGpuError> {
        let (gpu, precision) = (Arc::new(gpu), Precision::F32);
        let networks = load_networks(folder, n_steps, robots, |checkpoint, n_steps| {
            let network = checkpoint.load_on_gpu(&gpu, n_steps)?;
            Ok::<_, LoadGpuError>(Pi05Engine::Gpu(Box::new(network)))
        })?;
        Ok(Self { networks, precision })
    }

    fn network(&self, morphology: Morphology) -> Option<&Pi05Network> {
        self.networks.iter().find(|network| network.description.mapping.morphology == morphology)
    }
}

impl Policy for Pi05Policy {
    fn act(
        &mut self,
        observation: &ObservationView<'_>,
        answer: &mut [ActionChunk],
    ) -> Result<(), PolicyError> {
        assert_eq!(answer.len(), observation.n_envs(), "one chunk per env");
        let morphology = observation.morphology();
        let network = self.network(morphology);
        let network = network.ok_or(PolicyError::Morphology { found: morphology.name() })?;
        network.check(observation)?;
        let capacity = network.engine.capacity();
        for (first_env, answer) in (0..).step_by(capacity).zip(answer.chunks_mut(capacity)) {
            network.run(observation, first_env, answer)?;
        }
        Ok(())
    }

    fn flop_per_query(&self, morphology: Morphology, _execute: u32) -> u64 {
        self.network(morphology).map_or(0, Pi05Network::flop_per_query)
    }

    fn note(&self, execute: u32, stopwatch: Stopwatch<'_>) -> Option<String> {
        let notes = self.networks.iter().map(|network| network.note(self.precision, execute, stopwatch));
        Some(notes.collect::<Vec<_>>().join("; "))
    }
}

impl Pi05Engine {
    /// Returns the largest number of samples that are computed together.
    fn capacity(&self) -> usize {
        match self {
            Self::Cpu(_) => SAMPLES_PER_BATCH,
            #[cfg(feature = "gpu")]
            Self::Gpu(network) => network.capacity(),
        }
    }

    /// Computes a part of a layer, to be timed, and returns the number of floating-point operations; 0 on a
    /// device that is not timed.
    fn compute_sample(&self) -> u64 {
        match self {
            Self::Cpu(model) => model.compute_sample(),
            #[cfg(feature = "gpu")]
            Self::Gpu(_) => 0,
        }
    }

    /// Denoises `actions [n, horizon, action_width]` in place.
    fn sample(&self, input: Pi05Input<'_>, actions: &mut [f32]) -> Result<(), PolicyError> {
        match self {
            Self::Cpu(model) => model.sample(input, actions, None),
            #[cfg(feature = "gpu")]
            Self::Gpu(network) => network.sample(input, actions)?,
        }
        Ok(())
    }
}

impl Pi05Network {
    /// Returns the floating-point operations of a query with a prompt of typical length.
    fn flop_per_query(&self) -> u64 {
        let Pi05Description { architecture, mapping, .. } = &self.description;
        architecture.flop_per_query(mapping.cameras.len(), TYPICAL_PROMPT, self.n_steps)
    }

    /// Returns what the network is and, if a query takes long, how long.
    fn note(&self, precision: Precision, execute: u32, stopwatch: Stopwatch<'_>) -> String {
        let Pi05Description { architecture, mapping, prompt_state, .. } = &self.description;
        let flop = self.flop_per_query();
        let n_steps = self.n_steps;
        let n_weights = architecture.n_weights();
        let weights = match precision {
            Precision::F32 => "weights as stored",
            Precision::Int8 => "8-bit weights",
        };
        let convention = match prompt_state {
            PromptState::Unpadded => "unpadded",
            PromptState::Padded => "padded",
        };
        let mut text = format!(
            "π0.5 for {} tasks, {:.1} million {weights}, {n_steps} denoising steps, state {convention} in the prompt",
            mapping.morphology.name(),
            n_weights as f64 / 1e6,
        );
        if flop >= MIN_ANNOUNCED_FLOP {
            let mut sample_flop = 0;
            let seconds = stopwatch(&mut || sample_flop = self.engine.compute_sample());
            if sample_flop == 0 {
                return text;
            }
            let per_query = flop as f64 / sample_flop as f64 * seconds;
            let per_hundred = per_query * 100.0 / f64::from(execute.clamp(1, architecture.horizon as u32));
            text += &format!(
                "; a query takes about {per_query:.0} s on this machine, 100 control steps about {per_hundred:.0} s"
            );
        }
        text
    }

    fn check(&self, observation: &ObservationView<'_>) -> Result<(), PolicyError> {
        let mapping = &self.description.mapping;
        if !mapping.cameras.is_empty() && !observation.has_images() {
            return Err(PolicyError::NoImages);
        }
        if observation.control_mode() != mapping.control_mode {
            let (expected, found) = (mapping.control_mode.name(), observation.control_mode().name());
            return Err(PolicyError::ControlMode { expected, found });
        }
        (0..observation.n_envs()).try_for_each(|env_idx| {
            let (expected, found) = (mapping.morphology.state_dim(), observation.env(env_idx).state.len());
            if expected == found { Ok(()) } else { Err(PolicyError::StateDim { env_idx, expected, found }) }
        })
    }

    /// Computes the chunks of the envs starting at `first_env`, one per element of `answer`.
    fn run(
        &self,
        observation: &ObservationView<'_>,
        first_env: usize,
        answer: &mut [ActionChunk],
    ) -> Result<(), PolicyError> {
        let architecture = &self.description.architecture;
        let mut distinct = DistinctImages::default();
        let mut samples = Vec::with_capacity(answer.len());
        let mut actions = vec![0.0; answer.len() * architecture.horizon * architecture.action_width];
        let noise = actions.chunks_exact_mut(architecture.horizon * architecture.action_width);
        for (env_idx, noise) in (first_env..).zip(noise) {
            let env = observation.env(env_idx);
            let images =
                self.description.mapping.cameras.iter().map(|&camera| distinct.add(env.image(camera)));
            let (images, prompt) = (images.collect(), self.prompt(env.instruction, env.state)?);
            samples.push(SampleTokens { images, prompt });
            draw_noise(env.record.policy_seed, env.record.query, noise);
        }
        let images = distinct.resize(architecture.image_side());
        self.engine.sample(Pi05Input { images: &images, samples: &samples }, &mut actions)?;
        let Pi05Description { action, action_dim, .. } = &self.description;
        let chunks = actions.chunks_exact(architecture.horizon * architecture.action_width);
        for (chunk, answer) in chunks.zip(answer) {
            let rows = answer.reset(architecture.horizon, *action_dim).chunks_exact_mut(*action_dim);
            for (row, padded) in rows.zip(chunk.chunks_exact(architecture.action_width)) {
                row.copy_from_slice(&padded[..*action_dim]);
                action.restore(row);
            }
        }
        Ok(())
    }

    /// Returns the tokens of the prompt for an instruction and the robot's state.
    fn prompt(&self, instruction: &str, state: &[f32]) -> Result<Vec<u32>, PolicyError> {
        let Pi05Description { mapping, state: scaling, prompt_state, max_state_dim, .. } = &self.description;
        let mut own: Vec<f32> = mapping.state.iter().flat_map(|part| &state[part.clone()]).copied().collect();
        scaling.normalise(&mut own);
        if *prompt_state == PromptState::Padded {
            own.resize(*max_state_dim, 0.0);
        }
        self.prompter
            .tokens(&prompt(instruction, &own))
            .map_err(|error: TokenizerError| PolicyError::Instruction { reason: error.to_string() })
    }
}

impl<'a> DistinctImages<'a> {
    /// Returns the index of an image, adding it if no image with the same content is there yet.
    fn add(&mut self, (pixels, side): (&'a [u8], usize)) -> usize {
        let same_hash = self.by_hash.entry(xxh3_64(pixels)).or_default();
        if let Some(&idx) = same_hash.iter().find(|&&idx| self.images[idx] == (pixels, side)) {
            return idx;
        }
        same_hash.push(self.images.len());
        self.images.push((pixels, side));
        self.images.len() - 1
    }

    /// Returns the images as the network's input, `[n, 3, side, side]`.
    fn resize(&self, side: usize) -> Vec<f32> {
        let image_len = 3 * side * side;
        let mut planes = vec![0.0; self.images.len() * image_len];
        let jobs = planes.par_chunks_exact_mut(image_len).zip(&self.images);
        jobs.for_each(|(planes, &(pixels, own_side))| {
            let size = ImageSize { height: own_side, width: own_side };
            resize_with_pad(pixels, size, side, planes);
        });
        planes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_images_are_encoded_once() {
        let (first, second) = (vec![1_u8; 12], vec![2_u8; 12]);
        let copy = first.clone();
        let mut distinct = DistinctImages::default();
        let found = [&first, &second, &copy, &first].map(|pixels| distinct.add((pixels, 2)));
        assert_eq!(found, [0, 1, 0, 0]);
        assert_eq!(distinct.resize(2).len(), 2 * 3 * 4);
    }
}
