//! The configuration of a fleet: its program, places and lanes, timeouts and limits.

use std::path::PathBuf;
use std::time::Duration;

use ipc_types::Morphology;
use ipc_types::link::Domain;
use policy_host::serve::HostConfig;
use run_config::RunConfig;
use sim::serve::protocol::{Lane, SimConfig};

use crate::plan::capacity::Capacity;
use crate::plan::lanes::PolicyLane;

/// The configuration of a fleet.
#[derive(Clone, Debug)]
pub(crate) struct FleetConfig {
    /// The program to execute as `sim` and `policy-host`.
    pub(crate) program: PathBuf,
    /// Base folder of all runs of this user.
    pub(crate) base: PathBuf,
    /// Mount point of shared memory.
    pub(crate) shm: PathBuf,
    /// Random number that identifies the run.
    pub(crate) run_id: u64,
    /// Options of the run.
    pub(crate) run: RunConfig,
    /// Identity of the renderer of earlier results, which this run must match.
    pub(crate) earlier_renderer: Option<String>,
    /// `true` if the run may go on in another fleet, with other names in shared memory.
    pub(crate) can_move: bool,
    /// `true` if an episode is of use only together with its twins of the other policies.
    pub(crate) paired: bool,
    /// Numbers of envs.
    pub(crate) capacity: Capacity,
    /// Policies outside the sim, by lane.
    pub(crate) lanes: Vec<PolicyLane>,
    /// Morphologies of the tasks.
    pub(crate) morphologies: Vec<Morphology>,
    pub(crate) limits: Limits,
}

impl FleetConfig {
    /// Returns the configuration of a sim that starts with `envs` envs.
    pub(crate) fn sim(&self, domain: &Domain, envs: u32) -> SimConfig {
        SimConfig {
            domain: domain.clone(),
            run_id: self.run_id,
            max_envs: self.capacity.max_envs,
            envs,
            lanes: self.lanes.iter().map(|policy| policy.lane.clone()).collect(),
            run: self.run.clone(),
        }
    }

    /// Returns the configuration of a lane's host.
    pub(crate) fn host(&self, domain: &Domain, lane: u32) -> HostConfig {
        let policy = &self.lanes[lane as usize];
        HostConfig {
            domain: domain.clone(),
            run_id: self.run_id,
            lane: policy.lane.spec.clone(),
            spec: policy.spec.clone(),
            checkpoint: policy.checkpoint.clone(),
            morphologies: self.morphologies.clone(),
            execution: policy.execution,
            run: self.run.clone(),
        }
    }
}

/// Timeouts and the failure limit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    /// Time for a sim to get ready.
    pub(crate) sim_start: Duration,
    /// Time for a policy host to get ready, which includes loading its checkpoint.
    pub(crate) host_start: Duration,
    /// Time without output after which a sim counts as hung. A sim reports ten times a second.
    pub(crate) silence: Duration,
    /// Longest wait of a sim for a foreign host.
    pub(crate) foreign: Duration,
    /// Time for a child to exit after a request, before it is killed.
    pub(crate) shutdown: Duration,
    /// Number of failures of one child without a finished episode in between after which it is given up.
    pub(crate) failures: u32,
    /// The same for foreign hosts that leave.
    pub(crate) departures: u32,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            sim_start: Duration::from_secs(60),
            host_start: Duration::from_secs(120),
            silence: Duration::from_secs(60),
            foreign: Duration::from_secs(Lane::FOREIGN_HOST_TIMEOUT_S.into()),
            shutdown: Duration::from_secs(5),
            failures: 3,
            departures: 10,
        }
    }
}
