//! ACT: the network, and the policy around it.
//!
//! A sample is computed by one thread with sequential kernels, and samples run in parallel on the current rayon pool. The
//! samples that are left when there are fewer of them than threads are computed one after another by all threads together.
//! Either way every number is the result of the same operations in the same order.

pub mod architecture;
pub mod image;
pub mod model;
pub mod normalise;
pub mod tensors;

mod backbone;
mod flop;
mod instruction;
mod position;
mod team;
mod transformer;

use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use ipc_types::layout::{EXTERNAL_SIDE, HAND_SIDE};
use ipc_types::{ControlMode, Morphology, ObservationView};
use rayon::prelude::*;

use self::architecture::ImageSize;
use self::image::Image;
use self::instruction::TokenCache;
use self::model::{ActModel, ActScratch, Input};
use crate::checkpoint::{CONFIG_FILE, Checkpoint, Wiring};
use crate::ensemble::DEFAULT_DECAY;
use crate::nn::Precision;
use crate::policy::{ActionChunk, LoadError, Policy, PolicyError};
use crate::text::TextEncoder;

/// Sizes of the images in an observation.
pub const IMAGE_SIZES: [ImageSize; 2] = [
    ImageSize { height: EXTERNAL_SIDE, width: EXTERNAL_SIDE },
    ImageSize { height: HAND_SIDE, width: HAND_SIDE },
];

/// Most samples whose images a thread takes through the backbone together: its kernels are then read that much less often.
const SAMPLES_TOGETHER: usize = 4;

/// ACT for the morphologies that its checkpoint folder holds.
#[derive(Debug)]
pub struct ActPolicy {
    networks: Vec<Network>,
}

/// One morphology's network with what its threads work in.
#[derive(Debug)]
struct Network {
    model: ActModel,
    wiring: Wiring,
    /// Decay of a temporal ensemble's weights, where the checkpoint names one.
    ensemble_decay: Option<f64>,
    tokens: Mutex<TokenCache>,
    /// One for each thread, each computing samples of its own.
    workers: Vec<Worker>,
    /// All threads, computing one sample.
    team: Worker,
}

#[derive(Debug)]
struct Worker {
    scratch: ActScratch,
    /// `[D]`: the token of the sample's instruction.
    token: Vec<f32>,
    /// The sample's state, of those parts that the network sees.
    state: Vec<f32>,
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
        let wiring = checkpoint.wiring()?;
        found.push((wiring.morphology, wiring.control_mode));
        checkpoint.check_text_encoder()?;
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

impl ActPolicy {
    /// Loads the checkpoint in `folder` for up to `n_threads` threads.
    ///
    /// # Errors
    /// The first thing in the folder that is missing, unexpected or damaged.
    pub fn load(folder: &Path, precision: Precision, n_threads: usize) -> Result<Self, LoadError> {
        let mut networks = Vec::new();
        for inner in checkpoint_folders(folder)? {
            let mut checkpoint = Checkpoint::open(&inner)?;
            let (wiring, encoder) = (checkpoint.wiring()?.clone(), checkpoint.text_encoder()?);
            if networks.iter().any(|network: &Network| network.wiring.morphology == wiring.morphology) {
                let name = wiring.morphology.name();
                return Err(LoadError::Twice { folder: folder.to_owned(), morphology: name });
            }
            let weights = checkpoint.weights()?;
            let (architecture, normalisation) =
                (checkpoint.architecture().clone(), checkpoint.normalisation().clone());
            let model = ActModel::new(architecture, normalisation, &weights, precision, &IMAGE_SIZES);
            let ensemble_decay = checkpoint.ensemble_decay();
            networks.push(Network { ensemble_decay, ..Network::new(model, wiring, encoder, n_threads) });
        }
        Ok(Self { networks })
    }

    /// A policy of one network.
    #[must_use]
    pub fn new(model: ActModel, wiring: Wiring, encoder: Option<TextEncoder>, n_threads: usize) -> Self {
        Self { networks: vec![Network::new(model, wiring, encoder, n_threads)] }
    }
}

impl Policy for ActPolicy {
    fn act(
        &mut self,
        observation: &ObservationView<'_>,
        answer: &mut [ActionChunk],
    ) -> Result<(), PolicyError> {
        assert_eq!(answer.len(), observation.n_envs(), "one chunk per env");
        let morphology = observation.morphology();
        let network = self.networks.iter_mut().find(|network| network.wiring.morphology == morphology);
        let network = network.ok_or(PolicyError::Morphology { found: morphology.name() })?;
        network.check(observation)?;
        network.run(observation, answer);
        Ok(())
    }

    fn ensemble_decay(&self, morphology: Morphology) -> f64 {
        let network = self.networks.iter().find(|network| network.wiring.morphology == morphology);
        network.and_then(|network| network.ensemble_decay).unwrap_or(DEFAULT_DECAY)
    }
}

impl Network {
    fn new(model: ActModel, wiring: Wiring, encoder: Option<TextEncoder>, n_threads: usize) -> Self {
        let n_threads = n_threads.max(1);
        let worker = |n_samples, n_members| Worker {
            scratch: model.scratch(n_samples, n_members),
            token: vec![0.0; model.architecture().hidden_dim],
            state: vec![0.0; model.architecture().state_dim.unwrap_or(0)],
        };
        let workers = std::iter::repeat_with(|| worker(SAMPLES_TOGETHER, 1)).take(n_threads).collect();
        Self {
            workers,
            team: worker(1, n_threads),
            wiring,
            ensemble_decay: None,
            tokens: Mutex::new(TokenCache::new(encoder)),
            model,
        }
    }

    fn check(&self, observation: &ObservationView<'_>) -> Result<(), PolicyError> {
        let Wiring { morphology, control_mode, cameras, .. } = &self.wiring;
        if !cameras.is_empty() && !observation.has_images() {
            return Err(PolicyError::NoImages);
        }
        if observation.control_mode() != *control_mode {
            let (expected, found) = (control_mode.name(), observation.control_mode().name());
            return Err(PolicyError::ControlMode { expected, found });
        }
        (0..observation.n_envs()).try_for_each(|env_idx| {
            let (expected, found) = (morphology.state_dim(), observation.env(env_idx).state.len());
            if expected == found { Ok(()) } else { Err(PolicyError::StateDim { env_idx, expected, found }) }
        })
    }

    /// As many samples as make whole rounds of all threads, each wholly on one thread and as many together as leave no
    /// thread without; then the others by all threads.
    fn run(&mut self, observation: &ObservationView<'_>, answer: &mut [ActionChunk]) {
        let Self { model, wiring, tokens, workers, team, .. } = self;
        let n_threads = workers.len();
        let n_apart = answer.len() - answer.len() % n_threads;
        let (apart, together) = answer.split_at_mut(n_apart);
        let n_last = n_apart / n_threads % SAMPLES_TOGETHER;
        let (whole, last) = apart.split_at_mut(n_apart - n_last * n_threads);
        let mut first_env = 0;
        let jobs = whole.chunks_mut(SAMPLES_TOGETHER).chain(last.chunks_mut(n_last.max(1))).map(|chunks| {
            first_env += chunks.len();
            (first_env - chunks.len(), chunks)
        });
        let jobs = Mutex::new(jobs);
        workers.par_iter_mut().with_max_len(1).for_each(|worker| {
            while let Some((first_env, chunks)) = next(&jobs) {
                worker.run(model, wiring, tokens, (observation, first_env), chunks);
            }
        });
        for (first_env, chunks) in (n_apart..).zip(together.chunks_mut(1)) {
            team.run(model, wiring, tokens, (observation, first_env), chunks);
        }
    }
}

impl Worker {
    /// Answers the envs from `first_env` on, as many as there are chunks.
    fn run(
        &mut self,
        model: &ActModel,
        wiring: &Wiring,
        tokens: &Mutex<TokenCache>,
        (observation, first_env): (&ObservationView<'_>, usize),
        chunks: &mut [ActionChunk],
    ) {
        let image = |sample: usize, camera: usize| {
            let (pixels, side) = observation.env(first_env + sample).image(wiring.cameras[camera]);
            Image { pixels, size: ImageSize { height: side, width: side } }
        };
        model.look(chunks.len(), image, &mut self.scratch);
        for (sample, chunk) in chunks.iter_mut().enumerate() {
            let env = observation.env(first_env + sample);
            let has_token = match lock(tokens).get(env.instruction, model) {
                Some(token) => {
                    self.token.copy_from_slice(token);
                    true
                }
                None => false,
            };
            let mut rest = &mut self.state[..];
            for part in &wiring.state {
                let (own, others) = rest.split_at_mut(part.len());
                own.copy_from_slice(&env.state[part.clone()]);
                rest = others;
            }
            let input = Input { state: &self.state, instruction_token: has_token.then_some(&self.token) };
            let architecture = model.architecture();
            let rows = chunk.begin(architecture.horizon, architecture.action_dim);
            model.run(sample, input, &mut self.scratch, rows);
        }
    }
}

/// The next job of a queue shared by threads.
fn next<J>(jobs: &Mutex<impl Iterator<Item = J>>) -> Option<J> {
    lock(jobs).next()
}

/// A worker that panicked has already ended the query; what it guarded is still whole.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
