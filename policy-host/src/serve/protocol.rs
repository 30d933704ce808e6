//! Messages between a policy host and its parent: the configuration at start and the events that come back.

use ipc_types::Morphology;
use ipc_types::link::{Domain, LaneSpec};
use run_config::trace::TraceSpan;
use run_config::{Execution, RunConfig};
use serde::{Deserialize, Serialize};

use crate::PolicySpec;

/// Configuration of a host, passed by its parent at start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HostConfig {
    /// Domain of the run's shared memory.
    pub domain: Domain,
    /// Random id of the run. Observations of another run are rejected.
    pub run_id: u64,
    /// Lane to serve.
    pub lane: LaneSpec,
    /// Policy to load.
    pub spec: PolicySpec,
    /// Hash of the checkpoint at the start of the run ([`crate::formats::content`]), if the policy has one.
    /// The host answers with no other content.
    pub checkpoint: Option<String>,
    /// Robots of the run's tasks.
    pub morphologies: Vec<Morphology>,
    /// Use of the policy's chunks.
    pub execution: Execution,
    /// Options of the run.
    pub run: RunConfig,
}

/// Events that a host reports to its parent, one JSON object per line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum HostEvent {
    /// The policy is loaded and the lane is open.
    Ready {
        /// Time that loading the policy took, in ms.
        load_ms: f64,
    },
    /// Something that the user should know.
    Note {
        /// A sentence.
        message: String,
    },
    /// Cumulative work, sent at most ten times a second and once at the end.
    Ledger {
        /// Number of env queries answered.
        queries: u64,
        /// Number of observation messages answered.
        batches: u64,
        /// Core-seconds spent in the policy. With a device, those of the whole process while the
        /// device has a batch.
        busy_s: f64,
        /// Core-seconds of the whole process since its first query.
        cpu_s: f64,
        /// Wall seconds in which the policy's device had a batch; 0 without one.
        device_s: f64,
        /// Floating-point operations of the answered queries
        /// ([`Policy::flop_per_query`](crate::policy::Policy::flop_per_query)).
        flop: u64,
    },
    /// Activities of the threads since the last such event, if they are traced.
    Spans(Vec<TraceSpan>),
    /// A message could not be answered. The host continues.
    Failed {
        /// Error with its causes.
        message: String,
    },
}
