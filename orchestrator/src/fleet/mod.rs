//! The child processes of a run: spawned, supplied with episodes, supervised, restarted after a crash, and
//! shut down.
//!
//! A fleet owns the processes, the run's shared-memory domain and the queue of episodes. It knows nothing of
//! results files or terminals: everything it reports goes to a sink. There is one event enum and one loop
//! ([`supervisor`]), and every wait in that loop is bounded.

mod children;
mod clock;
mod error;
mod folder;
mod limits;
mod member;
mod process;
mod processes;
mod queue;
mod supervisor;
mod totals;
mod tuner;

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use ipc_types::link::Domain;
use ipc_types::run_config::Execution;
use ipc_types::trace::TraceSpan;
use ipc_types::{Morphology, RunConfig};
use policy_host::PolicySpec;
use policy_host::serve::HostConfig;
use sim::serve::protocol::{Counters, Lane, Outcome, SimConfig};

pub(crate) use self::error::FleetError;
pub(crate) use self::folder::base;
use self::member::MemberRole;
use self::process::ChildOutput;
use self::processes::Processes;
use self::queue::JobQueue;
use self::supervisor::Supervisor;
#[cfg(test)]
pub(crate) use self::totals::HostWork;
pub(crate) use self::totals::Totals;
pub(crate) use self::tuner::{EnvChoice, EnvTrial};
use crate::capacity::Capacity;
use crate::jobs::{Job, JobList};

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
    fn sim(&self, domain: &Domain, envs: u32) -> SimConfig {
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
    fn host(&self, domain: &Domain, lane: u32) -> HostConfig {
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

/// A policy outside the sim and its lane.
#[derive(Clone, Debug)]
pub(crate) struct PolicyLane {
    pub(crate) spec: PolicySpec,
    pub(crate) execution: Execution,
    /// Hash of its checkpoint at the start of the run.
    pub(crate) checkpoint: Option<String>,
    pub(crate) lane: Lane,
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

/// A report of the fleet to its sink.
#[derive(Debug)]
pub(crate) enum FleetEvent<'a> {
    /// An episode is finished.
    EpisodeFinished(&'a Job, &'a Outcome),
    /// Totals of all sims so far, about ten times a second.
    Counters(&'a Counters),
    /// A sim is ready; its renderer has this identity.
    RendererReady(&'a str),
    /// Activities of the threads of a child, by the child's name.
    Spans(&'a str, &'a [TraceSpan]),
    /// A line for the user.
    Log(&'a str),
}

/// The receiver of a fleet's events. An error ends the run.
pub(crate) type Sink<'a> = dyn FnMut(FleetEvent<'_>) -> anyhow::Result<()> + 'a;

/// Returns `true` if a job is still to be run when its turn comes. Others are dropped without an event.
pub(crate) type IsWanted<'a> = dyn Fn(&Job) -> bool + 'a;

/// The end of a run without an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RunStatus {
    /// All episodes are finished.
    Complete,
    /// The run was stopped.
    Stopped,
}

/// An input of the supervisor's loop.
#[derive(Debug)]
enum SupervisorEvent {
    /// Output of a child.
    Child(MemberRole, ChildOutput),
    /// A request to stop.
    Stop,
}

/// A fleet that has not started yet.
#[derive(Debug)]
pub(crate) struct Fleet {
    config: FleetConfig,
    events: Sender<SupervisorEvent>,
    inbox: Receiver<SupervisorEvent>,
}

/// Stops a fleet, from any thread. The first call shuts the children down, the second kills them.
#[derive(Clone, Debug)]
pub(crate) struct Stopper(Sender<SupervisorEvent>);

impl Stopper {
    /// Requests a stop.
    pub(crate) fn stop(&self) {
        // Sending fails only if the fleet has already ended.
        let _ = self.0.send(SupervisorEvent::Stop);
    }
}

impl Fleet {
    /// Makes a fleet. Starts nothing.
    pub(crate) fn new(config: FleetConfig) -> Self {
        let (events, inbox) = channel();
        Self { config, events, inbox }
    }

    /// Returns a handle that stops the fleet.
    pub(crate) fn stopper(&self) -> Stopper {
        Stopper(self.events.clone())
    }

    /// Runs those of `jobs` that are wanted when their turn comes. When this returns, no child is alive
    /// and the run's shared memory is removed.
    ///
    /// # Errors
    /// If there is not enough shared memory, a child fails repeatedly, a lane fails, or the sink returns an
    /// error. Episodes that finished before have gone to the sink.
    pub(crate) fn run(
        self,
        jobs: &JobList,
        is_wanted: &IsWanted<'_>,
        sink: &mut Sink<'_>,
    ) -> Result<(RunStatus, Totals), FleetError> {
        let config = &self.config;
        let specs: Vec<_> = config.lanes.iter().map(|policy| policy.lane.spec.clone()).collect();
        limits::ensure(&config.program, &specs, config.run.resources.n_threads())?;
        folder::prepare(&config.base)?;
        let n_removed = Domain::remove_stale(&config.base);
        if n_removed > 0 {
            let line = format!("removed the shared memory of {n_removed} crashed runs");
            sink(FleetEvent::Log(&line)).map_err(FleetError::Sink)?;
        }
        let domain = Domain::new(&config.base, config.run_id);
        let lease = match domain.create(&specs, &config.shm) {
            Ok(lease) => lease,
            Err(error) => {
                domain.remove_if_unused();
                return Err(error.into());
            }
        };
        let ran = folder::describe_foreign_lanes(config, &domain, sink).and_then(|()| {
            let mut children = Processes::new(&config.program, &domain, (self.events, self.inbox));
            let pending = JobQueue::new(jobs, config.paired, is_wanted);
            Supervisor::new(config, &domain, &mut children, pending, sink).run()
        });
        let removed = domain.remove();
        drop(lease);
        // Children of a killed run may still have been exiting when this run started.
        Domain::remove_stale(&config.base);
        let ran = ran?;
        removed?;
        Ok(ran)
    }
}

#[cfg(test)]
mod faults;
#[cfg(test)]
mod tests;
