//! The benchmark's ACT: checkpoints, the network, and the policy around it.
//!
//! A sample is computed by one thread with sequential kernels. Samples run in parallel on the current rayon pool; when
//! there are fewer of them than threads, the images of a sample do first, and the rest of it stays on one thread. Either
//! way every number is the result of the same operations in the same order.

pub mod checkpoint;
pub mod config;
pub mod image;
pub mod model;
pub mod tensors;

mod backbone;
mod flop;
mod language;
mod position;
mod transformer;

use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use ipc_types::frame::EnvObservation;
use ipc_types::layout::{EXTERNAL_BYTES, HAND_BYTES};
use ipc_types::{ActionBlock, ControlMode, Morphology, ObservationView};
use rayon::prelude::*;
use xxhash_rust::xxh3::Xxh3;

use self::checkpoint::{Checkpoint, CheckpointError, MODEL_FILE};
use self::config::{ActConfig, CONFIG_FILE};
use self::image::Image;
use self::language::TokenCache;
use self::model::{ActModel, ActScratch};
use crate::policy::{LoadError, Policy, PolicyError, begin_answer};

/// Places of a feature map.
const PLACES: usize = ActConfig::FEATURE_SIDE * ActConfig::FEATURE_SIDE;

/// ACT for the morphologies that its checkpoint folder holds.
#[derive(Debug)]
pub struct ActPolicy {
    networks: Vec<Network>,
}

/// One morphology's network with what its threads work in.
#[derive(Debug)]
struct Network {
    model: ActModel,
    tokens: Mutex<TokenCache>,
    workers: Vec<Worker>,
    /// `[fewer than n_workers envs, n_cameras, 7·7, n_features]`: features of images computed apart from their sample.
    features: Vec<f32>,
}

#[derive(Debug)]
struct Worker {
    scratch: ActScratch,
    /// `[n_image_tokens, n_features]` of the sample at hand.
    features: Vec<f32>,
    /// `[D]`: the token of its instruction.
    language: Vec<f32>,
}

/// The folders of a checkpoint: `folder` itself, or its sub-folders `single` and `bimanual`.
///
/// # Errors
/// If there is a checkpoint in none of them.
pub fn checkpoint_folders(folder: &Path) -> Result<Vec<PathBuf>, LoadError> {
    let has_config = |folder: &PathBuf| folder.join(CONFIG_FILE).is_file();
    if has_config(&folder.to_owned()) {
        return Ok(vec![folder.to_owned()]);
    }
    let inner = Morphology::ALL.map(|morphology| folder.join(morphology.name()));
    let found: Vec<_> = inner.into_iter().filter(has_config).collect();
    if found.is_empty() { Err(LoadError::NoCheckpoint { folder: folder.to_owned() }) } else { Ok(found) }
}

/// Checks configuration and header of a checkpoint against the robots it shall drive and how, without loading it.
///
/// # Errors
/// The first thing that does not fit.
pub fn check(folder: &Path, robots: &[(Morphology, ControlMode)]) -> Result<(), LoadError> {
    let mut found = Vec::new();
    for inner in checkpoint_folders(folder)? {
        let checkpoint = Checkpoint::open(&inner)?;
        found.push((robot(&inner, checkpoint.config())?, checkpoint.config().control_mode));
    }
    for &(morphology, control_mode) in robots {
        let Some((_, own)) = found.iter().find(|(robot, _)| *robot == morphology) else {
            let found: Vec<_> = found.iter().map(|(robot, _)| robot.name()).collect();
            let (folder, found) = (folder.to_owned(), found.join(", "));
            return Err(LoadError::Morphology { folder, found, expected: morphology.name() });
        };
        let (expected, found) = (control_mode.name(), own.name());
        if expected != found {
            let (folder, robot) = (folder.to_owned(), morphology.name());
            return Err(LoadError::ControlMode { folder, robot, expected, found });
        }
    }
    Ok(())
}

/// xxh3-64 over the files of a checkpoint, folder after folder.
///
/// # Errors
/// If a file cannot be read.
pub fn fingerprint(folder: &Path) -> Result<u64, LoadError> {
    let mut hash = Xxh3::new();
    for inner in checkpoint_folders(folder)? {
        for path in [inner.join(CONFIG_FILE), inner.join(MODEL_FILE)] {
            let bytes = std::fs::read(&path).map_err(|source| CheckpointError::Read { path, source })?;
            hash.update(&(bytes.len() as u64).to_le_bytes());
            hash.update(&bytes);
        }
    }
    Ok(hash.digest())
}

fn robot(folder: &Path, config: &ActConfig) -> Result<Morphology, LoadError> {
    config.morphology.ok_or_else(|| LoadError::NoMorphology { path: folder.join(CONFIG_FILE) })
}

impl ActPolicy {
    /// Loads the checkpoint in `folder` for up to `n_threads` threads.
    ///
    /// # Errors
    /// The first thing in the folder that is missing, unexpected or damaged.
    pub fn load(folder: &Path, n_threads: usize) -> Result<Self, LoadError> {
        let mut networks = Vec::new();
        for inner in checkpoint_folders(folder)? {
            let model = ActModel::load(&inner)?;
            let morphology = robot(&inner, model.config())?;
            if networks.iter().any(|network: &Network| network.model.config().morphology == Some(morphology))
            {
                let name = morphology.name();
                return Err(LoadError::Twice { folder: folder.to_owned(), morphology: name });
            }
            networks.push(Network::new(model, n_threads));
        }
        Ok(Self { networks })
    }

    /// A policy of one network.
    #[must_use]
    pub fn new(model: ActModel, n_threads: usize) -> Self {
        Self { networks: vec![Network::new(model, n_threads)] }
    }
}

impl Policy for ActPolicy {
    fn act(
        &mut self,
        observation: &ObservationView<'_>,
        answer: &mut [ActionBlock],
    ) -> Result<(), PolicyError> {
        assert_eq!(answer.len(), observation.n_envs(), "one block per env");
        let morphology = observation.morphology();
        let network =
            self.networks.iter_mut().find(|network| network.model.config().morphology == Some(morphology));
        let network = network.ok_or(PolicyError::Morphology { found: morphology.name() })?;
        network.check(observation)?;
        if observation.n_envs() < network.workers.len() {
            network.run_images_apart(observation, answer);
        } else {
            network.run_samples(observation, answer);
        }
        check_finite(answer)
    }
}

impl Network {
    fn new(model: ActModel, n_threads: usize) -> Self {
        let config = model.config();
        let n_workers = n_threads.max(1);
        let worker = || Worker {
            scratch: model.scratch(),
            features: vec![0.0; config.n_image_tokens() * model.n_features()],
            language: vec![0.0; config.hidden_dim],
        };
        let workers = std::iter::repeat_with(worker).take(n_workers).collect();
        let features = vec![0.0; (n_workers - 1) * config.n_image_tokens() * model.n_features()];
        Self { workers, features, tokens: Mutex::default(), model }
    }

    fn check(&self, observation: &ObservationView<'_>) -> Result<(), PolicyError> {
        let config = self.model.config();
        if !observation.has_images() {
            return Err(PolicyError::NoImages);
        }
        if observation.control_mode() != config.control_mode {
            let (expected, found) = (config.control_mode.name(), observation.control_mode().name());
            return Err(PolicyError::ControlMode { expected, found });
        }
        (0..observation.n_envs()).try_for_each(|env_idx| {
            let (expected, found) = (config.state_dim, observation.env(env_idx).state.len());
            if expected == found { Ok(()) } else { Err(PolicyError::StateDim { env_idx, expected, found }) }
        })
    }

    /// Each sample wholly on one thread.
    fn run_samples(&mut self, observation: &ObservationView<'_>, answer: &mut [ActionBlock]) {
        let Self { model, tokens, workers, .. } = self;
        let n_features = model.n_features();
        let jobs = Mutex::new(answer.iter_mut().enumerate());
        workers.par_iter_mut().with_max_len(1).for_each(|worker| {
            while let Some((env_idx, block)) = next(&jobs) {
                let env = observation.env(env_idx);
                let features = &mut worker.features;
                model.trunk(images(&env), &mut worker.scratch, |camera, row, col, from| {
                    let to = model.image_token(camera, row, col) * n_features;
                    features[to..to + n_features].copy_from_slice(from);
                });
                worker.head(model, tokens, &env, block);
            }
        });
    }

    /// Each image on one thread, then each sample's transformer on one thread.
    fn run_images_apart(&mut self, observation: &ObservationView<'_>, answer: &mut [ActionBlock]) {
        let Self { model, tokens, workers, features } = self;
        let n_features = model.n_features();
        let n_cameras = model.config().n_cameras;
        let n_images = observation.n_envs() * n_cameras;
        let jobs = Mutex::new(features.chunks_exact_mut(PLACES * n_features).take(n_images).enumerate());
        workers.par_iter_mut().with_max_len(1).for_each(|worker| {
            while let Some((image_idx, features)) = next(&jobs) {
                let env = observation.env(image_idx / n_cameras);
                let image = images(&env).skip(image_idx % n_cameras).take(1);
                model.trunk(image, &mut worker.scratch, |_, row, col, from| {
                    let to = (row * ActConfig::FEATURE_SIDE + col) * n_features;
                    features[to..to + n_features].copy_from_slice(from);
                });
            }
        });
        let jobs = Mutex::new(
            answer.iter_mut().zip(features.chunks_exact(n_cameras * PLACES * n_features)).enumerate(),
        );
        workers.par_iter_mut().with_max_len(1).for_each(|worker| {
            while let Some((env_idx, (block, sample))) = next(&jobs) {
                for (place, from) in sample.chunks_exact(n_features).enumerate() {
                    let (camera, place) = (place / PLACES, place % PLACES);
                    let (row, col) = (place / ActConfig::FEATURE_SIDE, place % ActConfig::FEATURE_SIDE);
                    let to = model.image_token(camera, row, col) * n_features;
                    worker.features[to..to + n_features].copy_from_slice(from);
                }
                worker.head(model, tokens, &observation.env(env_idx), block);
            }
        });
    }
}

impl Worker {
    /// From features to the answer's rows.
    fn head(
        &mut self,
        model: &ActModel,
        tokens: &Mutex<TokenCache>,
        env: &EnvObservation<'_>,
        block: &mut ActionBlock,
    ) {
        let has_language = match lock(tokens).get(env.instruction, model) {
            Some(token) => {
                self.language.copy_from_slice(token);
                true
            }
            None => false,
        };
        let language = has_language.then_some(self.language.as_slice());
        let config = model.config();
        let rows = begin_answer(block, env.record, config.num_queries, config.action_dim);
        model.head(&self.features, env.state, language, &mut self.scratch, rows);
    }
}

/// The cameras' images in the benchmark's order: external, then hand.
fn images<'a>(env: &EnvObservation<'a>) -> impl Iterator<Item = Image<'a>> + use<'a> {
    let external = env.external.chunks_exact(EXTERNAL_BYTES).map(Image::External);
    external.chain(env.hand.chunks_exact(HAND_BYTES).map(Image::Hand))
}

fn check_finite(answer: &[ActionBlock]) -> Result<(), PolicyError> {
    let bad = |block: &ActionBlock| block.rows.iter().any(|x| !x.is_finite());
    answer.iter().position(bad).map_or(Ok(()), |env_idx| Err(PolicyError::NotFinite { env_idx }))
}

/// The next job of a queue shared by threads.
fn next<J>(jobs: &Mutex<impl Iterator<Item = J>>) -> Option<J> {
    lock(jobs).next()
}

/// A worker that panicked has already ended the query; what it guarded is still whole.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
