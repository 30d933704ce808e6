//! The events of a fleet: what its supervisor receives, and what it reports.

use run_config::trace::TraceSpan;
use sim::serve::protocol::{Counters, Outcome};

use crate::fleet::processes::member::MemberRole;
use crate::fleet::processes::process::ChildOutput;
use crate::plan::jobs::Job;

/// A report of the fleet to its observer.
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

/// The receiver of a fleet's events.
pub(crate) trait Observer {
    /// Handles an event. An error ends the run.
    fn on_event(&mut self, event: &FleetEvent<'_>) -> anyhow::Result<()>;

    /// Returns `true` if a job is still to be run when its turn comes. Others are dropped without an event.
    fn is_wanted(&mut self, _job: &Job) -> bool {
        true
    }
}

impl<F: FnMut(&FleetEvent<'_>) -> anyhow::Result<()>> Observer for F {
    fn on_event(&mut self, event: &FleetEvent<'_>) -> anyhow::Result<()> {
        self(event)
    }
}

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
pub(crate) enum SupervisorEvent {
    /// Output of a child.
    Child(MemberRole, ChildOutput),
    /// A request to stop.
    Stop,
}
