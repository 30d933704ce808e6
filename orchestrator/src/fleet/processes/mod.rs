//! The real children: processes of the run's program, their events on a channel, and the run's domain.

pub(crate) mod clock;
pub(crate) mod member;
pub(crate) mod process;

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender};
use std::time::Duration;

use ipc_types::link::{Domain, Shortage};
use run_config::allotment;
use rustix::process::{Resource, getrlimit};

use self::clock::RunningClock;
use self::member::{ChildExit, MemberRole};
use self::process::ChildProcess;
pub(crate) use self::process::tell_kernel;
use super::children::Children;
use super::event::SupervisorEvent;

/// Resolution of [`ChildProcess::cpu_s`], with a margin, in s.
const TICK_S: f64 = 0.1;

/// The child processes of a run. Dropping it kills those that have not been waited for.
#[derive(Debug)]
pub(crate) struct Processes<'a> {
    program: &'a Path,
    domain: &'a Domain,
    events: Sender<SupervisorEvent>,
    inbox: Receiver<SupervisorEvent>,
    clock: RunningClock,
    by_role: BTreeMap<MemberRole, ChildProcess>,
    /// Files that the run needs.
    files: Vec<PathBuf>,
}

impl<'a> Processes<'a> {
    /// Makes the children of a run with this program and domain. Starts nothing.
    pub(crate) fn new(
        program: &'a Path,
        domain: &'a Domain,
        (events, inbox): (Sender<SupervisorEvent>, Receiver<SupervisorEvent>),
    ) -> Self {
        let clock = RunningClock::new();
        Self { program, domain, events, inbox, clock, by_role: BTreeMap::new(), files: Vec::new() }
    }
}

impl Children for Processes<'_> {
    fn spawn(&mut self, role: MemberRole, config: &str) -> io::Result<()> {
        let subcommand = match role {
            MemberRole::Sim => "sim",
            MemberRole::Host(_) => "policy-host",
        };
        let events = self.events.clone();
        let on_output = move |output| {
            // Sending fails only if the loop has ended, which then also ends the children.
            let _ = events.send(SupervisorEvent::Child(role, output));
        };
        let process = ChildProcess::spawn(self.program, subcommand, config, on_output)?;
        self.by_role.insert(role, process);
        Ok(())
    }

    fn send(&mut self, role: MemberRole, line: String) {
        if let Some(process) = self.by_role.get(&role) {
            process.send(line);
        }
    }

    fn close(&mut self, role: MemberRole) {
        if let Some(process) = self.by_role.get_mut(&role) {
            process.close();
        }
    }

    fn kill(&mut self, role: MemberRole) {
        if let Some(process) = self.by_role.get_mut(&role) {
            process.kill();
        }
    }

    fn wait(&mut self, role: MemberRole, timeout: Duration) -> Option<ChildExit> {
        let process = self.by_role.remove(&role)?;
        // The system tells it until the process has been waited for.
        let cpu_s = process.cpu_s();
        let exit = process.wait(timeout).map_or_else(ChildExit::Unknown, ChildExit::Exited);
        let limit = getrlimit(Resource::Cpu).current;
        let is_over = cpu_s.zip(limit).is_some_and(|(used, limit)| used >= limit as f64 - TICK_S);
        Some(if exit.was_killed() && is_over { ChildExit::OutOfTime } else { exit })
    }

    fn has_exited(&self, role: MemberRole) -> bool {
        self.by_role.get(&role).is_none_or(ChildProcess::has_exited)
    }

    fn memory_bytes(&self, role: MemberRole) -> Option<u64> {
        self.by_role.get(&role)?.memory_bytes()
    }

    fn cpu_s(&self, role: MemberRole) -> Option<f64> {
        self.by_role.get(&role)?.cpu_s()
    }

    fn next_event(&mut self, timeout: Duration) -> Option<SupervisorEvent> {
        let event = self.inbox.recv_timeout(timeout).ok();
        self.clock.update();
        event
    }

    fn update_clock(&mut self) {
        self.clock.update();
    }

    fn now(&self) -> Duration {
        self.clock.now()
    }

    fn free_memory(&mut self) -> bool {
        process::reap(self.program, self.domain)
    }

    fn intruder(&self) -> Option<u32> {
        self.domain.intruder()
    }

    fn shortage(&self) -> Option<Shortage> {
        Shortage::find()
    }

    fn watch_files(&mut self, is_ready: bool) {
        let sim = self.by_role.get(&MemberRole::Sim).filter(|_| is_ready);
        self.files = sim.map_or_else(Vec::new, |sim| self.domain.lasting_files(sim.id()));
    }

    fn lost_file(&self) -> Option<PathBuf> {
        self.files.iter().find(|path| !path.exists()).cloned()
    }

    fn oom_kills(&self) -> u64 {
        allotment::oom_kills()
    }

    fn n_cores(&self) -> u32 {
        allotment::n_cores()
    }

    fn idle_core_s(&self) -> Option<f64> {
        allotment::idle_core_s()
    }
}
