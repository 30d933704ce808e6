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
pub(super) struct FakeChild {
    /// Distinguishes it from the earlier children of its role.
    pub(super) id: u64,
    pub(super) program: FakeProgram,
    pub(super) spawned: Duration,
    pub(super) startup: Startup,
    pub(super) startup_at: Duration,
    pub(super) is_ready: bool,
    pub(super) is_hung: bool,
    pub(super) suspended_until: Duration,
    /// Commands that it has not read yet; `None` is the end of its stdin.
    pub(super) stdin: VecDeque<Option<SimCommand>>,
    /// Times at which the last lines on its stdin and stdout arrive.
    pub(super) stdin_end: Duration,
    pub(super) stdout_end: Duration,
    /// `true` once the supervisor has closed its stdin.
    pub(super) is_asked_to_exit: bool,
    /// `true` once the end of its stdout is on its way.
    pub(super) is_closed: bool,
    pub(super) status: Option<ExitStatus>,
    pub(super) has_user_error: bool,
}

pub(super) enum FakeProgram {
    Sim(Box<FakeSim>),
    Host(FakeHost),
}

/// The way in which a child's start ends.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Startup {
    Ready,
    Mute,
    Crash,
    UserError,
    RendererFails,
}

/// A simulated policy host. The sim tells it how many queries it has answered.
pub(super) struct FakeHost {
    pub(super) queries: u64,
    pub(super) reported: u64,
    pub(super) is_slow: bool,
}

impl FakeChild {
    pub(super) fn new(id: u64, program: FakeProgram, now: Duration, draw: &mut FaultInjector) -> Self {
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
    pub(super) fn is_running(&self, now: Duration) -> bool {
        self.status.is_none() && !self.is_hung && now >= self.suspended_until
    }
}

impl FakeHost {
    /// Returns a report if there is new work.
    pub(super) fn due(&mut self) -> Option<HostEvent> {
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

pub(super) fn exit_code(code: i32) -> ExitStatus {
    ExitStatus::from_raw(code << 8)
}

pub(super) fn signal(number: i32) -> ExitStatus {
    ExitStatus::from_raw(number)
}
