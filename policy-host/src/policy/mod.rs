//! The [`Policy`] trait, the types in its signature, and what is known of a policy before it is loaded. This
//! module knows none of the implementors, which are in [`models`](crate::models).

pub mod ensemble;
pub mod execution;

use bytemuck::Zeroable;
use ipc_types::layout::{MAX_ACTION_DIM, MAX_HORIZON};
use ipc_types::{ActionBlock, EnvRecord, Morphology, ObservationView};
use thiserror::Error;

/// Default decay `m` of a temporal ensemble's weights, as in the benchmark ([`crate::policy::ensemble`]).
pub const DEFAULT_ENSEMBLE_DECAY: f64 = 0.01;

/// The action chunk for one env, with any number of rows.
#[derive(Clone, Debug, Default)]
pub struct ActionChunk {
    /// Values `[n_rows, action_dim]`, row-major.
    values: Vec<f32>,
    action_dim: usize,
}

/// The rows of its chunks that a policy computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ChunkRows {
    /// Those that the sim will execute, as the record of each env says.
    Executed,
    /// All of them.
    All,
}

/// Maps observations to action chunks. The chunk for an env depends only on that env's record, images and
/// history.
pub trait Policy: Send {
    /// Writes one chunk into `answer` for each env of `observation`, in the same order. Runs on the current
    /// thread and may use the current rayon pool. Chunks may contain non-finite values; the simulator rejects
    /// them per env.
    ///
    /// # Errors
    /// If this policy cannot act on the observation. The contents of `answer` are then unspecified.
    ///
    /// # Panics
    /// If the length of `answer` is not the number of envs in the observation.
    fn act(
        &mut self,
        observation: &ObservationView<'_>,
        answer: &mut [ActionChunk],
    ) -> Result<(), PolicyError>;

    /// Returns the policy's pipeline if it computes on a device, where several batches can be in flight.
    fn pipeline(&mut self) -> Option<&mut dyn PolicyPipeline> {
        None
    }

    /// Asks for all rows of every chunk from now on. Otherwise a policy may leave out those that the sim will
    /// not execute.
    fn compute_whole_chunks(&mut self) {}

    /// Computes a part of a network, for a measurement of speed, and returns its floating-point operations; 0
    /// if a query takes so little time that [`startup_message`](Self::startup_message) does not mention it.
    /// Uses the current rayon pool.
    fn run_benchmark(&self) -> u64 {
        0
    }

    /// Returns a sentence for the user, before a run in which `execute` rows of each chunk are executed.
    /// `flop_per_s` is the speed of [`run_benchmark`](Self::run_benchmark).
    fn startup_message(&self, _execute: u32, _flop_per_s: f64) -> Option<String> {
        None
    }

    /// Returns the floating-point operations of a query for this robot of whose answer `execute` rows are
    /// executed, counted in matrix products and convolutions; 0 if the policy is no network.
    fn flop_per_query(&self, _morphology: Morphology, _execute: u32) -> u64 {
        0
    }

    /// Returns the decay `m` of the temporal ensemble's weights for this robot ([`crate::policy::ensemble`]).
    fn ensemble_decay(&self, _morphology: Morphology) -> f64 {
        DEFAULT_ENSEMBLE_DECAY
    }
}

/// [`Policy::act`] in two parts, between which a device computes and the host prepares the next batch.
/// Batches are collected or discarded in the order in which they were submitted.
pub trait PolicyPipeline {
    /// Copies what the policy needs of an observation and starts computing its chunks.
    ///
    /// # Errors
    /// Those of [`Policy::act`]. Then no batch was submitted.
    fn submit(&mut self, observation: &ObservationView<'_>) -> Result<(), PolicyError>;

    /// Returns `true` if the oldest batch is complete or has failed, so that nothing waits for it.
    fn is_ready(&mut self) -> bool;

    /// Waits for the oldest batch and writes one chunk into `answer` for each env of its observation.
    ///
    /// # Errors
    /// If the device fails.
    ///
    /// # Panics
    /// If no batch was submitted, or the length of `answer` is not the number of envs in the observation.
    fn collect(
        &mut self,
        observation: &ObservationView<'_>,
        answer: &mut [ActionChunk],
    ) -> Result<(), PolicyError>;

    /// Waits for the oldest batch and drops its chunks.
    ///
    /// # Errors
    /// If the device fails.
    ///
    /// # Panics
    /// If no batch was submitted.
    fn discard(&mut self) -> Result<(), PolicyError>;
}

/// Errors that can occur while a policy acts on an observation.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[expect(missing_docs, reason = "the messages describe the fields")]
pub enum PolicyError {
    #[error("policy `{policy}` does not support control mode {control_mode}: the state lacks what it needs")]
    Unsupported { policy: &'static str, control_mode: &'static str },
    #[error("the checkpoint has no network for a {found} robot")]
    Morphology { found: &'static str },
    #[error("the observation's control mode is {found}, the checkpoint was trained for {expected}")]
    ControlMode { expected: &'static str, found: &'static str },
    #[error("the observation has no images, which this policy needs")]
    NoImages,
    #[error("the state of env {env_idx} has {found} entries, expected {expected}")]
    StateDim { env_idx: usize, expected: usize, found: usize },
    #[error(
        "the query index of slot {slot} is {found}, expected {expected}, or 0 at the start of an episode"
    )]
    QueryGap { slot: u32, expected: u32, found: u32 },
    #[error("the instruction cannot be split into tokens: {reason}")]
    Instruction { reason: String },
    #[error("{message}")]
    Device { message: String },
    #[error("slot index {slot} is out of range, expected less than {limit}")]
    Slot { slot: u32, limit: u32 },
}

#[cfg(feature = "gpu")]
impl From<crate::nn::gpu::GpuError> for PolicyError {
    fn from(error: crate::nn::gpu::GpuError) -> Self {
        Self::Device { message: error.to_string() }
    }
}

impl ChunkRows {
    /// Returns the number of rows to compute of a chunk of `horizon` rows, of which `execute` will be
    /// executed.
    pub(crate) fn count(self, execute: u32, horizon: usize) -> usize {
        match self {
            Self::Executed => horizon.min(execute as usize),
            Self::All => horizon,
        }
    }
}

impl ActionChunk {
    /// Resizes the chunk to `[n_rows, action_dim]`, sets it to zero and returns its values, row-major and
    /// packed.
    ///
    /// # Panics
    /// If `n_rows` is zero, or `action_dim` is zero or exceeds [`MAX_ACTION_DIM`].
    pub fn reset(&mut self, n_rows: usize, action_dim: usize) -> &mut [f32] {
        assert!(n_rows > 0, "an action chunk needs at least one row");
        assert!(
            (1..=MAX_ACTION_DIM).contains(&action_dim),
            "action_dim {action_dim}, at most {MAX_ACTION_DIM}"
        );
        self.action_dim = action_dim;
        self.values.clear();
        self.values.resize(n_rows * action_dim, 0.0);
        &mut self.values
    }

    /// Returns the values `[n_rows, action_dim]`, row-major and packed.
    #[must_use]
    pub fn rows(&self) -> &[f32] {
        &self.values
    }

    /// Returns the number of entries in a row.
    #[must_use]
    pub fn action_dim(&self) -> usize {
        self.action_dim
    }

    /// Writes the wire representation into `block`: slot and query from `record`, and the first
    /// [`MAX_HORIZON`] rows.
    ///
    /// # Panics
    /// If [`reset`](Self::reset) was never called.
    pub fn write(&self, record: &EnvRecord, block: &mut ActionBlock) {
        let n_rows = (self.values.len() / self.action_dim).min(MAX_HORIZON);
        *block = ActionBlock {
            slot: record.slot,
            query: record.query,
            n_rows: n_rows as u32,
            action_dim: self.action_dim as u32,
            ..ActionBlock::zeroed()
        };
        let len = n_rows * self.action_dim;
        block.rows[..len].copy_from_slice(&self.values[..len]);
    }
}
