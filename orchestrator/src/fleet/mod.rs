//! The child processes of a run: spawned, supplied with episodes, supervised, restarted after a crash, and
//! shut down.
//!
//! A fleet owns the processes, the run's shared-memory domain and the queue of episodes. It knows nothing of
//! results files or terminals: everything it reports goes to an observer. There is one event enum and one
//! loop ([`supervisor`]), and every wait in that loop is bounded.

mod children;
mod config;
mod error;
mod event;
mod folder;
mod limits;
mod processes;
pub(crate) mod python;
mod queue;
mod supervisor;
pub(crate) mod tuning;

use std::sync::mpsc::{Receiver, Sender, channel};

use ipc_types::link::Domain;

pub(crate) use self::config::{FleetConfig, Limits};
pub(crate) use self::error::FleetError;
use self::event::SupervisorEvent;
pub(crate) use self::event::{FleetEvent, Observer, RunStatus};
pub(crate) use self::folder::{runtime_folder, server_endpoint};
use self::processes::Processes;
pub(crate) use self::processes::tell_kernel;
use self::queue::JobQueue;
use self::supervisor::Supervisor;
pub(crate) use self::tuning::env_choice::{EnvChoice, EnvTrial};
#[cfg(test)]
pub(crate) use self::tuning::totals::HostWork;
pub(crate) use self::tuning::totals::Totals;
use crate::plan::jobs::JobList;

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
    /// If there is not enough shared memory, a child fails repeatedly, a lane fails, or the observer
    /// returns an error. Episodes that finished before have gone to the observer.
    pub(crate) fn run(
        self,
        jobs: &JobList,
        observer: &mut dyn Observer,
    ) -> Result<(RunStatus, Totals), FleetError> {
        let config = &self.config;
        let specs: Vec<_> = config.lanes.iter().map(|policy| policy.lane.spec.clone()).collect();
        limits::ensure(&config.program, &specs, config.run.resources.n_threads())?;
        folder::prepare(&config.base)?;
        let n_removed = Domain::remove_stale(&config.base);
        if n_removed > 0 {
            let line = format!("removed the shared memory of {n_removed} crashed runs");
            observer.on_event(&FleetEvent::Log(&line)).map_err(FleetError::Observer)?;
        }
        let domain = Domain::new(&config.base, config.run_id);
        let lease = match domain.create(&specs, &config.shm) {
            Ok(lease) => lease,
            Err(error) => {
                domain.remove_if_unused();
                return Err(error.into());
            }
        };
        let ran = folder::describe_foreign_lanes(config, &domain, observer).and_then(|()| {
            let mut children = Processes::new(&config.program, &domain, (self.events, self.inbox));
            let pending = JobQueue::new(jobs, config.paired);
            Supervisor::new(config, &domain, &mut children, pending, observer).run()
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
#[path = "../../tests/faults/mod.rs"]
mod faults;
#[cfg(test)]
#[path = "../../tests/fleet/mod.rs"]
mod tests;
