//! The control plane between orchestrator and sim: one config on the command line, then JSON lines both ways.
//!
//! Observations and actions never travel here.

use ipc_types::RunConfig;
use ipc_types::link::{Domain, LaneSpec};
use serde::{Deserialize, Serialize};

use crate::perturb::Composition;
use crate::tasks::TaskId;

/// All a sim is told at birth (`hypogeum sim --config JSON`).
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SimConfig {
    /// Where the run's shared memory lives.
    pub domain: Domain,
    /// Random number that identifies the run in every header.
    pub run_id: u64,
    /// One per policy that runs outside the sim.
    pub lanes: Vec<Lane>,
    /// Options of the run.
    pub run: RunConfig,
}

/// A policy outside the sim.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Lane {
    /// Its shared memory.
    pub spec: LaneSpec,
    /// Whether it looks at images; if not, none is drawn for it.
    pub images: bool,
    /// Whether the host was started by someone else, so that the sim itself must watch whether it lives.
    pub foreign: bool,
}

/// Who acts in an episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Driver {
    /// The policy of this lane (index into [`SimConfig::lanes`]).
    Lane(u32),
    /// The scripted expert, inside the sim, with privileged state.
    Expert,
}

/// One episode to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Assignment {
    /// The orchestrator's number for it, returned with the outcome.
    pub id: u64,
    /// Who acts.
    pub driver: Driver,
    /// Task.
    pub task: TaskId,
    /// Perturbation, or several that act together.
    pub perturbation: Composition,
    /// Episode seed.
    pub seed: u64,
}

/// A line on the sim's stdin. End of input asks it to leave.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SimCommand {
    /// Queue an episode.
    Run(Assignment),
    /// The lane's policy host is connected: query it.
    HostUp {
        /// Lane index.
        lane: u32,
    },
    /// The lane's policy host died: its unfinished episodes start again when it is back.
    HostDown {
        /// Lane index.
        lane: u32,
    },
}

/// A line on the sim's stdout.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SimEvent {
    /// Lanes exist and are populated; hosts may connect.
    Ready {
        /// Bytes of shared memory reserved.
        shm_bytes: u64,
        /// Name of the renderer and its adapter.
        renderer: String,
        /// Its [`crate::render::Renderer::identity`].
        identity: String,
    },
    /// An episode is done.
    Finished(Box<Outcome>),
    /// Totals since the sim was born, about once a second and before it leaves.
    Progress(Counters),
    /// There is no renderer (any more): the sim leaves. Another one might draw other bits, so none takes its place.
    RendererFailed {
        /// One clear sentence.
        message: String,
    },
    /// Something is wrong with a lane; the run cannot go on with it.
    LaneFailed {
        /// Lane index.
        lane: u32,
        /// One clear sentence.
        message: String,
    },
}

/// Result of one episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Of the assignment.
    pub id: u64,
    /// Control steps executed.
    pub steps: u32,
    /// Success after any step.
    pub success_once: bool,
    /// Success after the last step.
    pub success_at_end: bool,
    /// First step after which success held, counted from 1.
    pub first_success_step: Option<u32>,
    /// First predicate that did not hold after the last step.
    pub failed_predicate: Option<String>,
    /// Hash of the trajectory: every executed action row and every state after it.
    pub fingerprint: u64,
    /// The executed action rows `[steps, action_dim]` as bit patterns of f32, if they are kept.
    pub actions: Option<Vec<u32>>,
    /// Where the episode's time went.
    pub ledger: EpisodeLedger,
    /// Why the episode could not be run to its end; apart from failure.
    pub error: Option<String>,
}

/// Seconds of one episode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EpisodeLedger {
    /// Seconds of its thread stepping physics, control and predicates included.
    pub physics_s: f64,
    /// Its share of the core-seconds that drawing its batches took.
    pub render_s: f64,
    /// Seconds between sending its observations and receiving the answers.
    pub policy_s: f64,
    /// Seconds in which it could go on but its turn had not come.
    pub wait_s: f64,
}

/// Totals of a sim.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Counters {
    /// Control steps executed, of finished and unfinished episodes.
    pub env_steps: u64,
    /// Images drawn.
    pub images: u64,
    /// Envs asked about (one query per env).
    pub queries: u64,
    /// Wall seconds of the measured window, from the first work (building the first world) to the end of the last control step.
    pub wall_s: f64,
    /// Core-seconds stepping.
    pub physics_s: f64,
    /// Core-seconds drawing.
    pub render_s: f64,
    /// Seconds within the measured window in which the sim had nothing to do.
    pub idle_s: f64,
}
