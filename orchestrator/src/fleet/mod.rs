//! The children of a run: started, fed, listened to, started again when they die, and sent home.
//!
//! It owns the processes, the run's shared-memory domain and the list of episodes that are still to be run. It knows
//! nothing of results files or terminals: what happens goes to a sink. One event enum, one loop ([`supervisor`]); every wait
//! in it is bounded.

mod clock;
mod error;
mod folder;
mod member;
mod process;
mod supervisor;
mod totals;

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use ipc_types::link::{Domain, check_budget};
use ipc_types::{Morphology, RunConfig};
use policy_host::PolicySpec;
use sim::serve::protocol::{Counters, Lane, Outcome};

pub(crate) use self::error::FleetError;
pub(crate) use self::folder::base;
use self::process::Said;
use self::supervisor::Supervisor;
#[cfg(test)]
pub(crate) use self::totals::HostWork;
pub(crate) use self::totals::Totals;
use crate::work::Job;

/// What a fleet is made of.
#[derive(Clone, Debug)]
pub(crate) struct Settings {
    /// The program that is executed as `sim` and `policy-host`.
    pub(crate) program: PathBuf,
    /// Folder under which the runs of this user live.
    pub(crate) base: PathBuf,
    /// The tmpfs of shared memory.
    pub(crate) shm: PathBuf,
    /// Random number that identifies the run.
    pub(crate) run_id: u64,
    /// Options of the run.
    pub(crate) config: RunConfig,
    /// Identity of the renderer that earlier results depend on.
    pub(crate) drawn_with: Option<String>,
    /// Policies outside the sim, by lane.
    pub(crate) lanes: Vec<LanePolicy>,
    /// Morphologies of the tasks.
    pub(crate) morphologies: Vec<Morphology>,
    /// Patience.
    pub(crate) limits: Limits,
}

/// A policy outside the sim and its lane.
#[derive(Clone, Debug)]
pub(crate) struct LanePolicy {
    /// What it is.
    pub(crate) spec: PolicySpec,
    /// Its lane.
    pub(crate) lane: Lane,
}

/// How long and how often.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    /// A sim is ready after this, or never.
    pub(crate) sim_start: Duration,
    /// A policy host is ready after this, or never; it has a checkpoint to load.
    pub(crate) host_start: Duration,
    /// A sim that says nothing for this long hangs; it reports every second.
    pub(crate) silence: Duration,
    /// A child that was asked to leave is gone after this, or killed.
    pub(crate) leave: Duration,
    /// Deaths of one child without a finished episode in between.
    pub(crate) deaths: u32,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            sim_start: Duration::from_secs(60),
            host_start: Duration::from_secs(120),
            silence: Duration::from_secs(60),
            leave: Duration::from_secs(5),
            deaths: 3,
        }
    }
}

/// What a fleet lets be known.
#[derive(Debug)]
pub(crate) enum Happening<'a> {
    /// An episode is done.
    Finished(&'a Job, &'a Outcome),
    /// Totals of all sims so far, about once a second.
    Counters(&'a Counters),
    /// A sim is ready and draws with the renderer of this identity.
    Drawing(&'a str),
    /// A line for people.
    Log(&'a str),
}

/// Receives what happens; an error ends the run.
pub(crate) type Sink<'a> = dyn FnMut(Happening<'_>) -> anyhow::Result<()> + 'a;

/// How a fleet's work ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Conclusion {
    /// All episodes are finished.
    Complete,
    /// It was stopped.
    Stopped,
}

/// What the loop listens to.
#[derive(Debug)]
enum Event {
    /// A child said something.
    Child(member::Place, Said),
    /// The user wants to stop.
    Stop,
}

/// A fleet that has not started yet.
#[derive(Debug)]
pub(crate) struct Fleet {
    settings: Settings,
    events: Sender<Event>,
    inbox: Receiver<Event>,
}

/// Stops a fleet, from any thread. The first call lets children leave, the second kills them.
#[derive(Clone, Debug)]
pub(crate) struct Stopper(Sender<Event>);

impl Stopper {
    pub(crate) fn stop(&self) {
        // A fleet that is gone needs no stopping.
        let _ = self.0.send(Event::Stop);
    }
}

impl Fleet {
    pub(crate) fn new(settings: Settings) -> Self {
        let (events, inbox) = channel();
        Self { settings, events, inbox }
    }

    pub(crate) fn stopper(&self) -> Stopper {
        Stopper(self.events.clone())
    }

    /// Runs `jobs`. When this returns no child is alive and nothing of the run is left in shared memory.
    ///
    /// # Errors
    /// If there is not enough shared memory, a child cannot be kept alive, a lane fails, or the sink refuses. What was
    /// finished has gone to the sink.
    pub(crate) fn run(self, jobs: Vec<Job>, sink: &mut Sink<'_>) -> Result<(Conclusion, Totals), FleetError> {
        let settings = &self.settings;
        folder::prepare(&settings.base)?;
        let n_swept = Domain::remove_stale(&settings.base);
        if n_swept > 0 {
            let line = format!("removed what {n_swept} dead runs had left in shared memory");
            sink(Happening::Log(&line)).map_err(FleetError::Sink)?;
        }
        let specs: Vec<_> = settings.lanes.iter().map(|policy| policy.lane.spec.clone()).collect();
        check_budget(&specs, &settings.shm)?;
        let domain = Domain::new(&settings.base, settings.run_id);
        let lease = domain.lease()?;
        let mut supervisor = Supervisor::new(settings, &domain, self.events, self.inbox, jobs, sink);
        let conclusion = supervisor.work();
        let closed = supervisor.close();
        let totals = supervisor.into_totals();
        let removed = domain.remove();
        drop(lease);
        // Children of a run that was killed may have been on their way out when this one started.
        Domain::remove_stale(&settings.base);
        let conclusion = conclusion?;
        closed?;
        removed?;
        Ok((conclusion, totals))
    }
}

#[cfg(test)]
mod tests;
