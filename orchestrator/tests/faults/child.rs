//! A simulated child process: its start, its pipes and its end.

use std::collections::VecDeque;
use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;
use std::time::Duration;

use policy_host::serve::HostEvent;
use sim::serve::protocol::SimCommand;

use super::injector::FaultInjector;
use super::scenario::FaultKind;
use super::sim::FakeSim;

/// A child from its spawn until the supervisor has waited for it.
pub(crate) struct FakeChild {
    /// Distinguishes it from the earlier children of its role.
    pub(crate) id: u64,
    pub(crate) program: FakeProgram,
    pub(crate) spawned: Duration,
    pub(crate) startup: Startup,
    pub(crate) startup_at: Duration,
    pub(crate) is_ready: bool,
    pub(crate) is_hung: bool,
    pub(crate) suspended_until: Duration,
    /// Commands that it has not read yet; `None` is the end of its stdin.
    pub(crate) stdin: VecDeque<Option<SimCommand>>,
    /// Times at which the last lines on its stdin and stdout arrive.
    pub(crate) stdin_end: Duration,
    pub(crate) stdout_end: Duration,
    /// `true` once the supervisor has closed its stdin.
    pub(crate) is_asked_to_exit: bool,
    /// `true` once the end of its stdout is on its way.
    pub(crate) is_closed: bool,
    pub(crate) status: Option<ExitStatus>,
    pub(crate) has_user_error: bool,
}

pub(crate) enum FakeProgram {
    Sim(Box<FakeSim>),
    Host(FakeHost),
}

/// The way in which a child's start ends.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Startup {
    Ready,
    Mute,
    Crash,
    UserError,
    RendererFails,
}

/// A simulated policy host. The sim tells it how many queries it has answered.
pub(crate) struct FakeHost {
    pub(crate) queries: u64,
    pub(crate) reported: u64,
    pub(crate) is_slow: bool,
}

impl FakeChild {
    pub(crate) fn new(id: u64, program: FakeProgram, now: Duration, draw: &mut FaultInjector) -> Self {
        let is_sim = matches!(program, FakeProgram::Sim(_));
        let startup = if draw.strikes(FaultKind::Mute, now) {
            Startup::Mute
        } else if draw.strikes(FaultKind::CrashAtStart, now) {
            Startup::Crash
        } else if draw.strikes(FaultKind::UserError, now) {
            Startup::UserError
        } else if is_sim && draw.strikes(FaultKind::RendererFails, now) {
            Startup::RendererFails
        } else {
            Startup::Ready
        };
        Self {
            id,
            program,
            spawned: now,
            startup,
            startup_at: now + draw.millis(50, 900),
            is_ready: false,
            is_hung: false,
            suspended_until: Duration::ZERO,
            stdin: VecDeque::new(),
            stdin_end: now,
            stdout_end: now,
            is_asked_to_exit: false,
            is_closed: false,
            status: None,
            has_user_error: false,
        }
    }

    /// Returns `true` if it does anything at the moment.
    pub(crate) fn is_running(&self, now: Duration) -> bool {
        self.status.is_none() && !self.is_hung && now >= self.suspended_until
    }
}

impl FakeHost {
    /// Returns a report if there is new work.
    pub(crate) fn due(&mut self) -> Option<HostEvent> {
        (self.queries > self.reported).then(|| {
            self.reported = self.queries;
            let busy_s = self.queries as f64 * 0.01;
            HostEvent::Ledger {
                queries: self.queries,
                batches: self.queries,
                busy_s,
                cpu_s: busy_s,
                device_s: 0.0,
                flop: self.queries,
            }
        })
    }
}

pub(crate) fn exit_code(code: i32) -> ExitStatus {
    ExitStatus::from_raw(code << 8)
}

pub(crate) fn signal(number: i32) -> ExitStatus {
    ExitStatus::from_raw(number)
}
