//! The behaviour of simulated children: their steps, the lines that they write, and their ends.

use std::process::ExitStatus;
use std::time::Duration;

use policy_host::serve::HostEvent;
use sim::serve::protocol::SimEvent;

use super::child::{FakeChild, FakeProgram, Startup, exit_code, signal};
use super::history::Meaning;
use super::scenario::{FaultKind, RENDERER};
use super::world::{FakeWorld, SIGKILL, WorldEvent, host_line, sim_line};
use crate::fleet::processes::member::MemberRole;
use crate::fleet::processes::process::ChildOutput;

/// Ends of a child that crashes: exit codes of errors and of a panic, and SIGSEGV, SIGBUS, SIGKILL and
/// SIGXCPU.
const CODES: [i32; 4] = [1, 2, 4, 101];
const SIGNALS: [i32; 4] = [11, 7, 9, 24];
const USER_ERROR: i32 = 2;

impl FakeWorld<'_, '_> {
    /// Lets a child do what is due, unless it has ended.
    pub(crate) fn tick(&mut self, role: MemberRole, id: u64) {
        let Some(mut child) = self.children.remove(&role) else { return };
        if child.id == id && child.status.is_none() && !child.is_hung {
            self.tick_child(role, &mut child);
        }
        self.children.insert(role, child);
    }

    fn tick_child(&mut self, role: MemberRole, child: &mut FakeChild) {
        if self.time >= child.suspended_until {
            if child.is_ready {
                self.work(role, child);
            } else {
                self.start_up(role, child);
            }
        }
        let next = self.time + self.draw.millis(30, 150);
        self.schedule(next.max(child.suspended_until), WorldEvent::Tick(role, child.id));
    }

    fn start_up(&mut self, role: MemberRole, child: &mut FakeChild) {
        match child.startup {
            Startup::Mute => child.is_hung = true,
            Startup::Crash => self.crash(role, child),
            Startup::UserError => {
                self.log(role, child, "error: a limit");
                child.has_user_error = true;
                self.end(role, child, exit_code(USER_ERROR));
            }
            Startup::RendererFails => self.fail_renderer(child),
            Startup::Ready => match role {
                MemberRole::Sim => self.get_sim_ready(child),
                MemberRole::Host(_) => self.get_host_ready(role, child),
            },
        }
    }

    fn get_sim_ready(&mut self, child: &mut FakeChild) {
        child.is_ready = true;
        if let FakeProgram::Sim(sim) = &mut child.program {
            sim.on_ready(self.time);
        }
        let is_other = self.draw.strikes(FaultKind::RendererChanges, self.time);
        let identity = if is_other { "gpu" } else { RENDERER }.to_owned();
        let event = SimEvent::Ready { shm_bytes: 5, renderer: identity.clone(), identity };
        self.emit_sim_event(child, event);
    }

    /// A host waits for a sim that has created its lane, though not for longer than a sim may take.
    fn get_host_ready(&mut self, role: MemberRole, child: &mut FakeChild) {
        if child.stdin.pop_front().is_some() {
            self.end(role, child, exit_code(0));
        } else if self.children.get(&MemberRole::Sim).is_some_and(|sim| sim.is_ready) {
            child.is_ready = true;
            self.emit(role, child, &Meaning::HostReady, &host_line(&HostEvent::Ready { load_ms: 1.0 }));
        } else if self.time - child.startup_at > self.scenario.config.limits.sim_start {
            self.log(role, child, "failed to open the lane");
            self.end(role, child, exit_code(1));
        }
    }

    fn work(&mut self, role: MemberRole, child: &mut FakeChild) {
        let now = self.time;
        if self.draw.strikes(FaultKind::Crash, now) {
            return self.crash(role, child);
        }
        if role == MemberRole::Sim && self.draw.strikes(FaultKind::RendererFails, now) {
            return self.fail_renderer(child);
        }
        if self.draw.strikes(FaultKind::OutOfMemory, now) {
            self.history.borrow_mut().n_oom_kills += 1;
            return self.end(role, child, signal(SIGKILL));
        }
        if let FakeProgram::Sim(sim) = &mut child.program
            && self.draw.strikes(FaultKind::Stall, now)
        {
            sim.is_stalled = true;
            self.record(|| "no episode proceeds any more".to_owned());
        }
        if self.draw.strikes(FaultKind::Hang, now) {
            child.is_hung = true;
            return self.record(|| format!("{role:?} hangs"));
        }
        if self.draw.strikes(FaultKind::Suspend, now) {
            child.suspended_until = now + self.draw.millis(200, 6_000);
            return self.record(|| format!("{role:?} is suspended"));
        }
        match role {
            MemberRole::Sim => self.work_as_sim(child),
            MemberRole::Host(_) => self.work_as_host(role, child),
        }
    }

    fn work_as_sim(&mut self, child: &mut FakeChild) {
        let hosts = self.lane_hosts();
        let FakeProgram::Sim(sim) = &mut child.program else { unreachable!("the sim runs a sim") };
        let mut is_closed = false;
        for command in child.stdin.drain(..) {
            match command {
                Some(command) => sim.handle(&command, &hosts),
                None => is_closed = true,
            }
        }
        let events =
            if is_closed { sim.on_closed(&hosts) } else { sim.tick(self.time, &hosts, &mut self.draw) };
        for lane in 0..hosts.len() {
            let answered = sim.take_answered(lane);
            if let Some(child) = self.children.get_mut(&MemberRole::Host(lane as u32))
                && let FakeProgram::Host(host) = &mut child.program
            {
                host.queries += answered;
            }
        }
        for event in events {
            self.emit_sim_event(child, event);
        }
        if is_closed {
            self.end(MemberRole::Sim, child, exit_code(0));
        }
    }

    fn work_as_host(&mut self, role: MemberRole, child: &mut FakeChild) {
        let is_closed = child.stdin.pop_front().is_some();
        let FakeProgram::Host(host) = &mut child.program else { unreachable!("a host runs a host") };
        if let Some(event) = host.due() {
            self.emit(role, child, &Meaning::Quiet, &host_line(&event));
        }
        if is_closed {
            self.end(role, child, exit_code(0));
        }
    }

    fn fail_renderer(&mut self, child: &mut FakeChild) {
        self.emit_sim_event(child, SimEvent::RendererFailed { message: "lost its GPU".to_owned() });
        self.end(MemberRole::Sim, child, exit_code(1));
    }

    fn crash(&mut self, role: MemberRole, child: &mut FakeChild) {
        let status = if self.draw.chance(0.5) {
            exit_code(self.draw.choose(&CODES))
        } else {
            signal(self.draw.choose(&SIGNALS))
        };
        self.end(role, child, status);
    }

    /// Ends a child, or closes only its stdout.
    pub(crate) fn end(&mut self, role: MemberRole, child: &mut FakeChild, status: ExitStatus) {
        if role == MemberRole::Sim && status.success() {
            self.lose_services();
        }
        if !child.is_closed {
            if !status.success() && self.draw.strikes(FaultKind::TruncateLine, self.time) {
                self.truncate_last_line(role);
            }
            // The log is read to its end first.
            let at = child.stdout_end.max(self.time) + self.draw.millis(0, 10);
            self.schedule(at, WorldEvent::Output(role, ChildOutput::Closed, Meaning::Closed));
            child.is_closed = true;
            let is_killed = std::os::unix::process::ExitStatusExt::signal(&status) == Some(9);
            if !is_killed && self.draw.strikes(FaultKind::Linger, self.time) {
                (child.is_hung, child.has_user_error) = (true, false);
                return self.record(|| format!("{role:?} closes its stdout"));
            }
        }
        child.status = Some(status);
        self.record(|| format!("{role:?} ends: {status}"));
    }

    fn emit_sim_event(&mut self, child: &mut FakeChild, event: SimEvent) {
        let line = sim_line(&event);
        self.emit(MemberRole::Sim, child, &Meaning::of(event), &line);
    }

    /// Writes a line to a child's stdout.
    fn emit(&mut self, role: MemberRole, child: &mut FakeChild, meaning: &Meaning, line: &str) {
        let (n_copies, is_intact, delay) = self.transport();
        child.stdout_end = child.stdout_end.max(self.time + delay);
        for _ in 0..n_copies {
            let (line, meaning) = if is_intact {
                (line, meaning.clone())
            } else {
                (&line[..self.draw.number(0, line.len() as u64 - 1) as usize], Meaning::Other)
            };
            let output = ChildOutput::Event(line.to_owned());
            self.schedule(child.stdout_end, WorldEvent::Output(role, output, meaning));
        }
    }

    /// Writes a line to a child's stderr. None is lost, and all arrive before the end of its stdout.
    fn log(&mut self, role: MemberRole, child: &FakeChild, line: &str) {
        let at = child.stdout_end.max(self.time);
        let output = ChildOutput::Log(line.to_owned());
        self.schedule(at, WorldEvent::Output(role, output, Meaning::Other));
    }

    /// Draws what happens to a line on a pipe: how often it arrives, `true` if it arrives intact, and its
    /// delay.
    pub(crate) fn transport(&mut self) -> (usize, bool, Duration) {
        let now = self.time;
        let n_copies = if self.draw.strikes(FaultKind::LoseLine, now) {
            0
        } else if self.draw.strikes(FaultKind::DuplicateLine, now) {
            2
        } else {
            1
        };
        let is_late = self.draw.strikes(FaultKind::DelayLine, now);
        let delay = if is_late { self.draw.millis(100, 2_500) } else { self.draw.millis(0, 5) };
        (n_copies, !self.draw.strikes(FaultKind::TruncateLine, now), delay)
    }
}
