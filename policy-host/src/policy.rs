//! The word "policy": a thing that answers observations with action chunks, how it is loaded, and how it is refused.

use std::path::PathBuf;

use bytemuck::Zeroable;
use ipc_types::layout::{MAX_ACTION_DIM, MAX_HORIZON};
use ipc_types::{ActionBlock, ControlMode, EnvRecord, Morphology, ObservationView};
use thiserror::Error;

use crate::QueryMode;
use crate::act::{self, ActPolicy};
use crate::checkpoint::CheckpointError;
use crate::ensemble::{DEFAULT_DECAY, Ensemble};
use crate::idle::Idle;
use crate::nn::Precision;
use crate::random::Random;
use crate::spec::PolicySpec;

/// An answer to one env: rows of an action chunk, of any number.
#[derive(Clone, Debug, Default)]
pub struct ActionChunk {
    /// `[n_rows, action_dim]`.
    numbers: Vec<f32>,
    action_dim: usize,
}

/// Answers observations with action chunks. An env's answer depends on that env's record, images and past only.
pub trait Policy: Send {
    /// Fills one chunk of `answer` per env of `observation`, in its order. It runs on the current thread and may spread over
    /// the current rayon pool. An answer may hold numbers that are not finite: the simulator refuses them, env by env.
    ///
    /// # Errors
    /// If the observation is not one this policy can answer; `answer` is then worthless.
    ///
    /// # Panics
    /// If `answer` has another length than the observation has envs.
    fn act(
        &mut self,
        observation: &ObservationView<'_>,
        answer: &mut [ActionChunk],
    ) -> Result<(), PolicyError>;

    /// Decay of a temporal ensemble's weights over this robot's chunks ([`crate::ensemble`]).
    fn ensemble_decay(&self, _morphology: Morphology) -> f64 {
        DEFAULT_DECAY
    }
}

/// An observation that a policy cannot answer.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[expect(missing_docs, reason = "the fields are named by their messages")]
pub enum PolicyError {
    #[error("answer in {control_mode}: policy `{policy}` cannot, its observation says too little")]
    Unsupported { policy: &'static str, control_mode: &'static str },
    #[error("answer for a {found} robot: the checkpoint has no network for it")]
    Morphology { found: &'static str },
    #[error("answer in {found}: the checkpoint was trained for {expected}")]
    ControlMode { expected: &'static str, found: &'static str },
    #[error("answer without images: the observation has none")]
    NoImages,
    #[error("read env {env_idx}: its state has {found} numbers, expected {expected}")]
    StateDim { env_idx: usize, expected: usize, found: usize },
    #[error("follow slot {slot}: its query is {found}, expected {expected} or a new episode's 0")]
    QueryGap { slot: u32, expected: u32, found: u32 },
    #[error("follow slot {slot}: slots must be below {limit}")]
    Slot { slot: u32, limit: u32 },
}

/// A policy that cannot be loaded.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the fields are named by their messages")]
pub enum LoadError {
    #[error("host policy `{spec}`: it does not run in a policy host")]
    NotHosted { spec: PolicySpec },
    #[error(
        "find a checkpoint in {}: neither it nor its folders `single` and `bimanual` have a config.json",
        folder.display()
    )]
    NoCheckpoint { folder: PathBuf },
    #[error("{0}")]
    Checkpoint(Box<CheckpointError>),
    #[error("use {}: the checkpoint is for {found}, the run has {expected} tasks", folder.display())]
    Morphology { folder: PathBuf, found: String, expected: &'static str },
    #[error("use {}: it drives the {robot} robot by {found}, the run by {expected}", folder.display())]
    ControlMode { folder: PathBuf, robot: &'static str, found: &'static str, expected: &'static str },
    #[error("use {}: both its folders hold a checkpoint for {morphology}", folder.display())]
    Twice { folder: PathBuf, morphology: &'static str },
}

impl From<CheckpointError> for LoadError {
    fn from(error: CheckpointError) -> Self {
        Self::Checkpoint(Box::new(error))
    }
}

/// Loads a policy that answers on up to `n_threads` threads of the rayon pool it is called in.
///
/// # Errors
/// If the policy does not run in a host, or its checkpoint cannot be loaded.
pub fn load(spec: &PolicySpec, n_threads: usize, mode: QueryMode) -> Result<Box<dyn Policy>, LoadError> {
    let policy: Box<dyn Policy> = match spec {
        PolicySpec::Idle => Box::new(Idle),
        PolicySpec::Random => Box::new(Random),
        PolicySpec::Act(folder) => Box::new(ActPolicy::load(folder, Precision::F32, n_threads)?),
        PolicySpec::ActInt8(folder) => Box::new(ActPolicy::load(folder, Precision::Int8, n_threads)?),
        PolicySpec::Expert | PolicySpec::Attach(_) => {
            return Err(LoadError::NotHosted { spec: spec.clone() });
        }
    };
    Ok(match mode {
        QueryMode::Chunk => policy,
        QueryMode::Ensemble => Box::new(Ensemble::new(policy)),
    })
}

/// Whether a policy can drive these robots in these control modes, as far as can be seen without loading it: for a
/// checkpoint, its configuration and its header are read.
///
/// # Errors
/// The first thing that does not fit.
pub fn check(spec: &PolicySpec, robots: &[(Morphology, ControlMode)]) -> Result<(), LoadError> {
    match spec {
        PolicySpec::Idle | PolicySpec::Random | PolicySpec::Expert | PolicySpec::Attach(_) => Ok(()),
        PolicySpec::Act(folder) | PolicySpec::ActInt8(folder) => act::check(folder, robots),
    }
}

impl ActionChunk {
    /// Starts an answer: all rows zero. They are returned, `[n_rows, action_dim]` packed.
    ///
    /// # Panics
    /// If there are no rows, or they are empty or wider than an answer's.
    pub fn begin(&mut self, n_rows: usize, action_dim: usize) -> &mut [f32] {
        assert!(n_rows > 0 && (1..=MAX_ACTION_DIM).contains(&action_dim), "an action chunk");
        self.action_dim = action_dim;
        self.numbers.clear();
        self.numbers.resize(n_rows * action_dim, 0.0);
        &mut self.numbers
    }

    /// `[n_rows, action_dim]`, packed.
    #[must_use]
    pub fn rows(&self) -> &[f32] {
        &self.numbers
    }

    /// Numbers in a row.
    #[must_use]
    pub fn action_dim(&self) -> usize {
        self.action_dim
    }

    /// Its message: slot and query as in the record, and as many rows as a block holds.
    ///
    /// # Panics
    /// If the answer was never begun.
    pub fn write(&self, record: &EnvRecord, block: &mut ActionBlock) {
        let n_rows = (self.numbers.len() / self.action_dim).min(MAX_HORIZON);
        *block = ActionBlock {
            slot: record.slot,
            query: record.query,
            n_rows: n_rows as u32,
            action_dim: self.action_dim as u32,
            ..ActionBlock::zeroed()
        };
        let len = n_rows * self.action_dim;
        block.rows[..len].copy_from_slice(&self.numbers[..len]);
    }
}
