//! The control protocol between orchestrator and sim: one configuration on the command line, then JSON lines
//! in both directions.
//!
//! Observations and actions never pass through here; they travel over the link.

use ipc_types::ImageSizes;
use ipc_types::link::{Domain, LaneSpec};
use run_config::RunConfig;
use run_config::trace::TraceSpan;
use serde::{Deserialize, Serialize};

pub use super::latencies::Latencies;
use crate::perturb::Composition;
use crate::tasks::TaskId;

/// Start-up configuration of a sim process (`hypogeum sim --config JSON`).
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SimConfig {
    /// Location of the run's shared memory.
    pub domain: Domain,
    /// Random number that identifies the run in every header.
    pub run_id: u64,
    /// Largest number of episodes in progress at a time.
    pub max_envs: u32,
    /// Number of episodes in progress at a time, until [`SimCommand::Envs`] changes it.
    pub envs: u32,
    /// One lane per policy that runs outside the sim.
    pub lanes: Vec<Lane>,
    /// Options of the run.
    pub run: RunConfig,
}

/// The connection to one policy that runs outside the sim.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Lane {
    /// Size and layout of the lane's shared memory.
    pub spec: LaneSpec,
    /// Sizes of the images that the policy sees; `None` if it uses none, in which case none is rendered.
    pub images: Option<ImageSizes>,
    /// `true` if the host was not started by the orchestrator, so that the sim itself has to check that it is
    /// alive.
    pub foreign: bool,
    /// Seconds after which an unanswered query counts as lost.
    pub answer_timeout_s: u32,
    /// Rows of each answer that are executed before the next query.
    pub execute: u32,
}

impl Lane {
    /// Timeout for answers of most policies.
    pub const ANSWER_TIMEOUT_S: u32 = 120;
    /// Longest wait for a foreign host to connect or to reconnect, in seconds.
    pub const FOREIGN_HOST_TIMEOUT_S: u32 = 600;
}

/// The source of an episode's actions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Driver {
    /// The policy of this lane (an index into [`SimConfig::lanes`]).
    Lane(u32),
    /// The scripted expert, which runs inside the sim with access to privileged state.
    Expert,
}

/// One episode to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Assignment {
    /// The orchestrator's identifier of the episode, returned with its [`Outcome`].
    pub id: u64,
    /// Source of the actions.
    pub driver: Driver,
    /// The task to run.
    pub task: TaskId,
    /// The perturbation, or several that act together.
    pub perturbation: Composition,
    /// Episode seed; see [`scene::stream::episode_seed`].
    pub seed: u64,
}

/// A request on the sim's stdin, one JSON line each. End of input asks the sim to exit.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SimCommand {
    /// Queues an episode.
    Run(Assignment),
    /// Changes the number of episodes in progress at a time, up to [`SimConfig::max_envs`]. If there are
    /// more, none is started until enough of them have finished.
    Envs {
        /// The new number.
        count: u32,
    },
    /// Announces that the lane's policy host is connected and accepts queries.
    HostUp {
        /// Index of the lane.
        lane: u32,
    },
    /// Announces that the lane's policy host has exited. Its unfinished episodes restart when a host is
    /// connected again.
    HostDown {
        /// Index of the lane.
        lane: u32,
    },
    /// Drops all episodes of the lane's policy, which has failed too often. None will follow.
    GiveUp {
        /// Index of the lane.
        lane: u32,
    },
}

/// An event on the sim's stdout, one JSON line each.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SimEvent {
    /// The lanes exist and their memory is populated; hosts may connect.
    Ready {
        /// Bytes of shared memory reserved.
        shm_bytes: u64,
        /// Name of the renderer and its adapter.
        renderer: String,
        /// The renderer's [`render::Renderer::identity`].
        identity: String,
    },
    /// An episode has finished.
    Finished(Box<Outcome>),
    /// Totals since the process started, sent about ten times a second and before it exits.
    Progress(Counters),
    /// Activities of the threads since the last such event, if they are traced.
    Spans(Vec<TraceSpan>),
    /// The renderer could not be opened or has failed, and the sim exits. It does not fall back to another
    /// renderer, whose images could differ in single bits.
    RendererFailed {
        /// The error in one sentence.
        message: String,
    },
    /// A policy has failed to answer, or answered incorrectly. Its host gets no queries until
    /// [`SimCommand::HostUp`]; a foreign host gets them again at once.
    LaneFailed {
        /// Index of the lane.
        lane: u32,
        /// The error in one sentence.
        message: String,
        /// `true` if no further attempt is worth its time.
        is_final: bool,
    },
    /// A foreign host has left. Its unfinished episodes restart with the next one.
    HostLost {
        /// Index of the lane.
        lane: u32,
    },
    /// The sim has had nothing to do for a second, and holds only these episodes. The orchestrator
    /// compares this with what it has sent, so that a lost message costs time but no episode.
    Waiting {
        /// [`Assignment::id`] of all unfinished episodes, in ascending order.
        held: Vec<u64>,
        /// By lane: `true` if its policy host is connected.
        hosts: Vec<bool>,
    },
}

/// Result of one episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// [`Assignment::id`] of the episode.
    pub id: u64,
    /// Number of control steps executed.
    pub steps: u32,
    /// `true` if the task was successful after at least one step.
    pub success_once: bool,
    /// `true` if the task was successful after the last step.
    pub success_at_end: bool,
    /// First step after which the task was successful, counted from 1.
    pub first_success_step: Option<u32>,
    /// Name of the first predicate that did not hold after the last step.
    pub failed_predicate: Option<String>,
    /// Hash of the trajectory: the initial state, then every executed action row and the state after it.
    pub fingerprint: u64,
    /// The executed action rows, `[steps, action_dim]` as bit patterns of f32, if they are recorded.
    pub actions: Option<Vec<u32>>,
    /// Time spent on the episode, by stage.
    pub ledger: EpisodeLedger,
    /// The reason why the episode could not be completed. Such an episode counts as an error, not as a
    /// failure.
    pub error: Option<String>,
}

impl Outcome {
    /// Returns success after at least one step; `None` if the episode could not be completed.
    #[must_use]
    pub fn success(&self) -> Option<bool> {
        self.error.is_none().then_some(self.success_once)
    }
}

/// Time spent on one episode, in seconds by stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EpisodeLedger {
    /// Wall seconds of stepping, including control and predicates.
    pub physics_s: f64,
    /// The episode's share of the core-seconds spent rendering its batches.
    pub render_s: f64,
    /// Wall seconds between sending its observations and receiving the answers.
    pub policy_s: f64,
    /// Remaining wall seconds, in which the episode waited for its turn.
    pub wait_s: f64,
}

/// Totals of a sim process.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Counters {
    /// Control steps executed, in finished and unfinished episodes.
    pub env_steps: u64,
    /// Number of images rendered.
    pub images: u64,
    /// Queries sent; a batch counts once per env.
    pub queries: u64,
    /// Wall seconds of the measured window, from the first work (building the first world) to the end of the
    /// last control step.
    pub wall_s: f64,
    /// Core-seconds of building worlds and stepping them.
    pub physics_s: f64,
    /// Core-seconds of rendering.
    pub render_s: f64,
    /// Wall seconds of rendering on a device; 0 on the CPU.
    pub device_s: f64,
    /// Wall seconds within the measured window in which the sim had nothing to do.
    pub idle_s: f64,
    /// Core-seconds of the whole process within the measured window.
    pub cpu_s: f64,
    /// By lane: wall seconds within the measured window in which a foreign host had an unanswered query. An
    /// answer that arrives while the sim works counts from the sim's last look before; 0 for other hosts.
    #[serde(default)]
    pub foreign_s: Vec<f64>,
    /// Times between sending queries and receiving their answers.
    pub latencies: Latencies,
}
