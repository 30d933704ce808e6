//! One place in the fleet: the child that fills it now, and what became of those before.

use std::collections::VecDeque;
use std::fmt;
use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;
use std::time::Duration;

use super::process::Process;

/// Lines of a child's log that an error shows.
const LOG_LINES: usize = 8;

/// Which place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    /// The one sim.
    Sim,
    /// The policy host of this lane.
    Host(u32),
}

/// A place and the child in it.
#[derive(Debug, Default)]
pub(super) struct Member {
    state: State,
    /// Deaths since an episode of this member was last finished.
    deaths: u32,
    log: VecDeque<String>,
}

#[derive(Debug, Default)]
enum State {
    #[default]
    Empty,
    /// Started at this time of the fleet's clock.
    Starting(Process, Duration),
    /// Last heard of at this time of the fleet's clock.
    Up(Process, Duration),
}

/// How a child ended.
#[derive(Debug)]
pub(crate) enum Death {
    /// With this status.
    Exit(ExitStatus),
    /// Nobody knows.
    Unknown(std::io::Error),
}

impl fmt::Display for Death {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Exit(status) => match (status.code(), status.signal()) {
                (Some(code), _) => write!(f, "exited with code {code}"),
                (None, Some(signal)) => write!(f, "was killed by signal {signal}"),
                (None, None) => write!(f, "ended ({status})"),
            },
            Self::Unknown(error) => write!(f, "ended in an unknown way ({error})"),
        }
    }
}

impl Member {
    /// A child was started.
    pub(super) fn started(&mut self, process: Process, now: Duration) {
        self.state = State::Starting(process, now);
        self.log.clear();
    }

    /// The child said that it is ready.
    pub(super) fn ready(&mut self, now: Duration) {
        self.state = match std::mem::take(&mut self.state) {
            State::Starting(process, _) | State::Up(process, _) => State::Up(process, now),
            State::Empty => State::Empty,
        };
    }

    /// The child said something.
    pub(super) fn heard(&mut self, now: Duration) {
        if let State::Up(_, heard) = &mut self.state {
            *heard = now;
        }
    }

    /// The child logged a line.
    pub(super) fn logged(&mut self, line: &str) {
        if self.log.len() == LOG_LINES {
            self.log.pop_front();
        }
        self.log.push_back(line.to_owned());
    }

    /// The end of the child's log.
    pub(super) fn log(&self) -> Vec<String> {
        self.log.iter().cloned().collect()
    }

    /// An episode of this member was finished: its deaths are forgiven.
    pub(super) fn forgive(&mut self) {
        self.deaths = 0;
    }

    /// Takes the dying child out and waits for it. Counts as a death.
    pub(super) fn bury(&mut self, patience: Duration) -> Option<Death> {
        let process = self.take()?;
        self.deaths += 1;
        Some(process.wait(patience).map_or_else(Death::Unknown, Death::Exit))
    }

    /// Deaths since an episode was last finished.
    pub(super) fn deaths(&self) -> u32 {
        self.deaths
    }

    /// Whether the child is ready to work.
    pub(super) fn is_up(&self) -> bool {
        matches!(self.state, State::Up(..))
    }

    /// Whether there is no child.
    pub(super) fn is_empty(&self) -> bool {
        matches!(self.state, State::Empty)
    }

    /// How long the child has been starting.
    pub(super) fn starting_for(&self, now: Duration) -> Option<Duration> {
        if let State::Starting(_, since) = self.state { Some(now - since) } else { None }
    }

    /// How long a child that is up has said nothing.
    pub(super) fn silent_for(&self, now: Duration) -> Option<Duration> {
        if let State::Up(_, heard) = self.state { Some(now - heard) } else { None }
    }

    /// The child.
    pub(super) fn process(&mut self) -> Option<&mut Process> {
        match &mut self.state {
            State::Empty => None,
            State::Starting(process, _) | State::Up(process, _) => Some(process),
        }
    }

    /// Takes the child out.
    pub(super) fn take(&mut self) -> Option<Process> {
        match std::mem::take(&mut self.state) {
            State::Empty => None,
            State::Starting(process, _) | State::Up(process, _) => Some(process),
        }
    }
}
