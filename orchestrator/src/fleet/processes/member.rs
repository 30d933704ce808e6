//! A member of the fleet: a role, the state of the child that currently fills it, and its failures so far.

use std::collections::VecDeque;
use std::fmt;
use std::os::unix::process::ExitStatusExt;
use std::process;
use std::time::Duration;

use rustix::process::Signal;

use crate::console::exit::LINK_FAILED;

/// Number of log lines that an error shows.
const LOG_LINES: usize = 8;
/// Exit code of a child for an error that the user can fix.
const USER_ERROR: i32 = 2;
/// Start of a child's last message.
const ERROR_PREFIX: &str = "error: ";

/// The role of a child process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum MemberRole {
    /// The only sim.
    Sim,
    /// The policy host of this lane.
    Host(u32),
}

/// A role and the child that fills it.
#[derive(Debug, Default)]
pub(crate) struct Member {
    state: MemberState,
    /// Times of its failures since this member last took part in a finished episode.
    failures: VecDeque<Duration>,
    /// Times at which a foreign host has left since then.
    departures: VecDeque<Duration>,
    log: VecDeque<String>,
    /// `true` if the supervisor has killed the child.
    is_killed: bool,
}

#[derive(Clone, Copy, Debug, Default)]
enum MemberState {
    #[default]
    Vacant,
    /// A child that is starting, and the time of its spawn.
    Starting(Duration),
    /// A child that is ready, and the time of its last output.
    Up(Duration),
}

/// The end of a child process.
#[derive(Debug)]
pub(crate) enum ChildExit {
    /// It exited with this status.
    Exited(process::ExitStatus),
    /// The kernel killed it because it had used all core-seconds of its limit.
    OutOfTime,
    /// Waiting for it failed.
    Unknown(std::io::Error),
}

impl ChildExit {
    /// Returns the signal that ended the child.
    fn signal(&self) -> Option<i32> {
        if let Self::Exited(status) = self { status.signal() } else { None }
    }

    /// Returns `true` if the kernel could not give the child memory for a page of a file (SIGBUS).
    pub(crate) fn lacked_memory(&self) -> bool {
        self.signal() == Some(Signal::BUS.as_raw())
    }

    /// Returns `true` if the child was killed (SIGKILL), as the kernel does if memory runs out.
    pub(crate) fn was_killed(&self) -> bool {
        self.signal() == Some(Signal::KILL.as_raw())
    }

    /// Returns `true` if the child has used the core-seconds that its limit allows (SIGXCPU, then SIGKILL).
    pub(crate) fn lacked_time(&self) -> bool {
        matches!(self, Self::OutOfTime) || self.signal() == Some(Signal::XCPU.as_raw())
    }

    /// Returns `true` if the child could not use the run's shared memory.
    pub(crate) fn lacked_link(&self) -> bool {
        matches!(self, Self::Exited(status) if status.code() == Some(LINK_FAILED.into()))
    }
}

impl fmt::Display for ChildExit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Exited(status) => match (status.code(), status.signal()) {
                (Some(code), _) => write!(f, "exited with code {code}"),
                (None, Some(signal)) => write!(f, "was killed by signal {signal}"),
                (None, None) => write!(f, "ended ({status})"),
            },
            Self::OutOfTime => f.write_str("used all core-seconds of its limit"),
            Self::Unknown(error) => write!(f, "ended with an unknown status ({error})"),
        }
    }
}

impl Member {
    /// Records that a child was spawned.
    pub(crate) fn on_spawn(&mut self, now: Duration) {
        self.state = MemberState::Starting(now);
        self.log.clear();
        self.is_killed = false;
    }

    /// Records that the child is ready.
    pub(crate) fn on_ready(&mut self, now: Duration) {
        if !self.is_vacant() {
            self.state = MemberState::Up(now);
        }
    }

    /// Records that the child wrote something.
    pub(crate) fn on_output(&mut self, now: Duration) {
        if let MemberState::Up(last_output) = &mut self.state {
            *last_output = now;
        }
    }

    /// Starts the timeouts of this child anew.
    pub(crate) fn restart_clock(&mut self, now: Duration) {
        if let MemberState::Starting(since) | MemberState::Up(since) = &mut self.state {
            *since = now;
        }
    }

    /// Records a line of the child's log.
    pub(crate) fn on_log(&mut self, line: &str) {
        if self.log.len() == LOG_LINES {
            self.log.pop_front();
        }
        self.log.push_back(line.to_owned());
    }

    /// Returns the last lines of the child's log.
    pub(crate) fn log_tail(&self) -> Vec<String> {
        self.log.iter().cloned().collect()
    }

    /// Forgets all failures after a finished episode.
    pub(crate) fn reset_failures(&mut self) {
        self.failures.clear();
        self.departures.clear();
    }

    /// Records a failure. Returns the number of failures within the last `window`.
    pub(crate) fn add_failure(&mut self, now: Duration, window: Duration) -> u32 {
        add_within(&mut self.failures, now, window)
    }

    /// Records that a foreign host has left. Returns how many have left within the last `window`.
    pub(crate) fn add_departure(&mut self, now: Duration, window: Duration) -> u32 {
        add_within(&mut self.departures, now, window)
    }

    /// Records that the supervisor kills the child.
    pub(crate) fn on_kill(&mut self) {
        self.is_killed = true;
    }

    /// Returns `true` if somebody else has ended the child: the kernel for lack of memory, or a signal that a
    /// user or a batch system sends.
    pub(crate) fn was_ended(&self, exit: &ChildExit) -> bool {
        const SENT: [Signal; 4] = [Signal::KILL, Signal::TERM, Signal::INT, Signal::HUP];
        !self.is_killed && exit.signal().is_some_and(|found| SENT.iter().any(|sent| sent.as_raw() == found))
    }

    /// Records that the child was waited for.
    pub(crate) fn on_exit(&mut self) {
        self.state = MemberState::Vacant;
    }

    /// Returns the error of a child that has exited because of something the user can fix. Its log ends with
    /// it.
    pub(crate) fn user_error(&self, exit: &ChildExit) -> Option<String> {
        let ChildExit::Exited(status) = exit else { return None };
        let start = self.log.iter().rposition(|line| line.starts_with(ERROR_PREFIX))?;
        let lines: Vec<&str> = self.log.iter().skip(start).map(String::as_str).collect();
        let message = lines.join(" | ");
        (status.code() == Some(USER_ERROR)).then(|| message[ERROR_PREFIX.len()..].to_owned())
    }

    /// Returns `true` if the child is ready to work.
    pub(crate) fn is_up(&self) -> bool {
        matches!(self.state, MemberState::Up(..))
    }

    /// Returns `true` if there is no child.
    pub(crate) fn is_vacant(&self) -> bool {
        matches!(self.state, MemberState::Vacant)
    }

    /// Returns the time since the spawn of a child that is not ready yet.
    pub(crate) fn starting_for(&self, now: Duration) -> Option<Duration> {
        if let MemberState::Starting(since) = self.state { Some(now - since) } else { None }
    }

    /// Returns the time since the last output of a ready child.
    pub(crate) fn silent_for(&self, now: Duration) -> Option<Duration> {
        if let MemberState::Up(last_output) = self.state { Some(now - last_output) } else { None }
    }
}

/// Adds a time and drops those that are older than `window`. Returns their number.
fn add_within(times: &mut VecDeque<Duration>, now: Duration, window: Duration) -> u32 {
    times.retain(|time| now.saturating_sub(*time) <= window);
    times.push_back(now);
    times.len() as u32
}
