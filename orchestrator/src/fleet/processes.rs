//! The real children: processes of the run's program, their events on a channel, and the run's domain.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender};
use std::time::Duration;

use ipc_types::link::{Domain, Shortage};
use ipc_types::run_config;

use super::SupervisorEvent;
use super::children::Children;
use super::clock::RunningClock;
use super::member::{ChildExit, MemberRole};
use super::process::ChildProcess;

/// The child processes of a run. Dropping it kills those that have not been waited for.
#[derive(Debug)]
pub(super) struct Processes<'a> {
    program: &'a Path,
    domain: &'a Domain,
    events: Sender<SupervisorEvent>,
    inbox: Receiver<SupervisorEvent>,
    clock: RunningClock,
    by_role: BTreeMap<MemberRole, ChildProcess>,
}

impl<'a> Processes<'a> {
    /// Makes the children of a run with this program and domain. Starts nothing.
    pub(super) fn new(
        program: &'a Path,
        domain: &'a Domain,
        (events, inbox): (Sender<SupervisorEvent>, Receiver<SupervisorEvent>),
    ) -> Self {
        Self { program, domain, events, inbox, clock: RunningClock::new(), by_role: BTreeMap::new() }
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
        Some(process.wait(timeout).map_or_else(ChildExit::Unknown, ChildExit::Exited))
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

    fn free_memory(&mut self) -> Option<usize> {
        self.domain.reap()
    }

    fn intruder(&self) -> Option<u32> {
        self.domain.intruder()
    }

    fn shortage(&self) -> Option<Shortage> {
        Shortage::find()
    }

    fn n_cores(&self) -> u32 {
        run_config::n_cores()
    }
}
