//! The simulated world: children, pipes and time. Virtual time passes only while the supervisor waits.

use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::path::PathBuf;
use std::time::Duration;

use ipc_types::link::Shortage;
use policy_host::serve::{HostConfig, HostEvent};
use sim::serve::protocol::{SimCommand, SimConfig, SimEvent};

use super::super::SupervisorEvent;
use super::super::children::Children;
use super::child::{FakeChild, FakeHost, FakeProgram, signal};
use super::foreign::ForeignHosts;
use super::history::{Meaning, RunHistory};
use super::injector::FaultInjector;
use super::scenario::{FaultKind, FaultScenario};
use super::sim::{FakeSim, LaneHost};
use crate::fleet::processes::clock::MAX_TICK;
use crate::fleet::processes::member::{ChildExit, MemberRole};
use crate::fleet::processes::process::ChildOutput;

/// Maximum virtual time and number of events of a run, above all that any scenario needs.
const MAX_TIME: Duration = Duration::from_secs(300);
const MAX_EVENTS: u64 = 200_000;
pub(crate) const SIGKILL: i32 = 9;

/// Everything outside the supervisor.
pub(crate) struct FakeWorld<'a, 's> {
    pub(crate) scenario: &'s FaultScenario,
    pub(crate) history: &'a RefCell<RunHistory<'s>>,
    pub(crate) draw: FaultInjector,
    /// Virtual time.
    pub(crate) time: Duration,
    pub(crate) children: BTreeMap<MemberRole, FakeChild>,
    pub(crate) foreign: ForeignHosts,
    /// The supervisor's clock and the virtual time of its last update.
    clock: Duration,
    clock_updated: Duration,
    /// Future events in the order of their times, and of their making if these are equal.
    queue: BTreeMap<(Duration, u64), WorldEvent>,
    n_events: u64,
    inbox: VecDeque<(SupervisorEvent, Meaning)>,
    n_spawns: u64,
    intruder: Option<u32>,
    shortage: bool,
    /// `true` while the supervisor needs the run's files.
    needs_files: bool,
    lost_file: Option<&'static str>,
}

/// A change of the world.
pub(crate) enum WorldEvent {
    /// Output of a child arrives at the supervisor.
    Output(MemberRole, ChildOutput, Meaning),
    /// A command, or the end of its stdin, arrives at the child with this id.
    Input(MemberRole, u64, Option<SimCommand>),
    /// The child with this id does something.
    Tick(MemberRole, u64),
    /// Foreign hosts come and go.
    ForeignTick,
    /// The user requests a stop.
    Stop,
}

impl<'a, 's> FakeWorld<'a, 's> {
    pub(crate) fn new(scenario: &'s FaultScenario, history: &'a RefCell<RunHistory<'s>>) -> Self {
        let mut draw = FaultInjector::of(scenario);
        let foreign = ForeignHosts::new(&scenario.config.lanes, &mut draw);
        let mut world = Self {
            scenario,
            history,
            draw,
            time: Duration::ZERO,
            children: BTreeMap::new(),
            foreign,
            clock: Duration::ZERO,
            clock_updated: Duration::ZERO,
            queue: BTreeMap::new(),
            n_events: 0,
            inbox: VecDeque::new(),
            n_spawns: 0,
            intruder: None,
            shortage: false,
            needs_files: false,
            lost_file: None,
        };
        for &stop in &scenario.stops {
            world.schedule(stop, WorldEvent::Stop);
        }
        world.schedule(Duration::ZERO, WorldEvent::ForeignTick);
        world
    }

    pub(crate) fn schedule(&mut self, at: Duration, event: WorldEvent) {
        self.n_events += 1;
        self.queue.insert((at, self.n_events), event);
    }

    pub(crate) fn record(&self, text: impl FnOnce() -> String) {
        self.history.borrow_mut().record(text);
    }

    /// Lets virtual time pass until `until`, or until `is_over` holds after an event.
    fn pass(&mut self, until: Duration, is_over: impl Fn(&Self) -> bool) {
        while !is_over(self) {
            let Some(entry) = self.queue.first_entry().filter(|entry| entry.key().0 <= until) else {
                return self.set_time(until);
            };
            let ((at, _), event) = entry.remove_entry();
            self.set_time(at);
            assert!(self.time < MAX_TIME && self.n_events < MAX_EVENTS, "the run does not end");
            self.handle(event);
        }
    }

    fn set_time(&mut self, time: Duration) {
        self.time = self.time.max(time);
        self.history.borrow_mut().time = self.time;
    }

    fn handle(&mut self, event: WorldEvent) {
        match event {
            WorldEvent::Output(role, output, meaning) => {
                self.inbox.push_back((SupervisorEvent::Child(role, output), meaning));
            }
            WorldEvent::Stop => self.inbox.push_back((SupervisorEvent::Stop, Meaning::Other)),
            WorldEvent::Input(role, id, command) => {
                if let Some(child) = self.children.get_mut(&role).filter(|child| child.id == id) {
                    child.stdin.push_back(command);
                }
            }
            WorldEvent::Tick(role, id) => self.tick(role, id),
            WorldEvent::ForeignTick => {
                self.foreign.tick(self.time, &mut self.draw);
                self.schedule(self.time + Duration::from_millis(100), WorldEvent::ForeignTick);
            }
        }
    }

    /// Returns the hosts that the lanes connect the sim to.
    pub(crate) fn lane_hosts(&self) -> Vec<Option<LaneHost>> {
        let hosted = |lane: u32| {
            let child = self.children.get(&MemberRole::Host(lane))?;
            let FakeProgram::Host(host) = &child.program else { return None };
            let answers = child.is_running(self.time);
            let is_attached = child.is_ready && child.status.is_none();
            is_attached.then_some(LaneHost { id: child.id, answers, is_slow: host.is_slow })
        };
        let lanes = (0..).zip(&self.scenario.config.lanes);
        lanes
            .map(|(lane, policy)| if policy.lane.foreign { self.foreign.get(lane) } else { hosted(lane) })
            .collect()
    }

    /// Returns the program that a configuration describes.
    fn program(&mut self, role: MemberRole, config: &str) -> FakeProgram {
        match role {
            MemberRole::Sim => {
                let config: SimConfig = serde_json::from_str(config).unwrap();
                FakeProgram::Sim(Box::new(FakeSim::new(&config, self.scenario)))
            }
            MemberRole::Host(lane) => {
                let config: HostConfig = serde_json::from_str(config).unwrap();
                assert_eq!(config.lane.lane, lane);
                let is_slow = self.draw.strikes(FaultKind::SlowHost, self.time);
                FakeProgram::Host(FakeHost { queries: 0, reported: 0, is_slow })
            }
        }
    }

    /// Removes the services, as a sim does that leaves in order, or who frees the memory of one that has not.
    pub(crate) fn lose_services(&mut self) {
        if self.needs_files {
            self.lost_file = self.lost_file.or(Some("lane.dynamic"));
        }
    }

    /// Ends a process that has not ended yet.
    fn kill_now(&mut self, role: MemberRole) {
        if let Some(mut child) = self.children.remove(&role) {
            if child.status.is_none() {
                self.end(role, &mut child, signal(SIGKILL));
            }
            self.children.insert(role, child);
        }
    }

    /// Truncates a line that the supervisor has not received yet: the last one of a process that was killed
    /// while it wrote it.
    pub(crate) fn truncate_last_line(&mut self, of: MemberRole) {
        let is_last = |event: &&mut WorldEvent| matches!(event, WorldEvent::Output(role, ..) if *role == of);
        let last = self.queue.values_mut().rev().find(is_last);
        if let Some(WorldEvent::Output(_, ChildOutput::Event(line), meaning)) = last {
            let length = self.draw.number(0, line.len().saturating_sub(1) as u64);
            line.truncate(length as usize);
            *meaning = Meaning::Other;
        }
    }
}

impl Children for FakeWorld<'_, '_> {
    fn spawn(&mut self, role: MemberRole, config: &str) -> io::Result<()> {
        assert!(!self.children.contains_key(&role), "nobody has waited for the previous child of {role:?}");
        if self.draw.strikes(FaultKind::SpawnFails, self.time) {
            self.history.borrow_mut().on_spawn_error();
            return Err(io::ErrorKind::WouldBlock.into());
        }
        let program = self.program(role, config);
        self.n_spawns += 1;
        let child = FakeChild::new(self.n_spawns, program, self.time, &mut self.draw);
        self.schedule(child.startup_at, WorldEvent::Tick(role, child.id));
        self.children.insert(role, child);
        self.history.borrow_mut().on_spawn(role, self.clock);
        Ok(())
    }

    fn send(&mut self, role: MemberRole, line: String) {
        let command: SimCommand = serde_json::from_str(&line).unwrap();
        assert_eq!(role, MemberRole::Sim, "a host reads no commands");
        self.history.borrow_mut().on_command(&command);
        let Some(child) = self.children.get(&role).filter(|child| !child.is_asked_to_exit) else { return };
        let (id, sent) = (child.id, child.stdin_end);
        let (n_copies, is_intact, delay) = self.transport();
        let at = sent.max(self.time + delay);
        if is_intact {
            for _ in 0..n_copies {
                self.schedule(at, WorldEvent::Input(role, id, Some(command.clone())));
            }
        }
        self.children.entry(role).and_modify(|child| child.stdin_end = at);
    }

    fn close(&mut self, role: MemberRole) {
        self.history.borrow_mut().on_shutdown(self.clock);
        if let Some(child) = self.children.get_mut(&role) {
            child.is_asked_to_exit = true;
            let (at, id) = (child.stdin_end.max(self.time), child.id);
            self.schedule(at, WorldEvent::Input(role, id, None));
        }
    }

    fn kill(&mut self, role: MemberRole) {
        self.history.borrow_mut().turn.killed.push(role);
        if self.children.contains_key(&role) {
            self.history.borrow_mut().on_kill(role, self.clock);
            self.kill_now(role);
        }
    }

    fn wait(&mut self, role: MemberRole, timeout: Duration) -> Option<ChildExit> {
        let has_ended = |world: &Self| world.children.get(&role).is_none_or(|child| child.status.is_some());
        self.pass(self.time + timeout, has_ended);
        self.kill_now(role);
        let child = self.children.remove(&role)?;
        self.history.borrow_mut().on_exit(role, &child, self.clock);
        self.intruder = self.draw.strikes(FaultKind::Intruder, self.time).then_some(1001);
        self.shortage = self.draw.strikes(FaultKind::Shortage, self.time);
        if self.needs_files && self.draw.strikes(FaultKind::Vanish, self.time) {
            self.lost_file = Some("nodes.global_mgmt");
        }
        child.status.map(ChildExit::Exited)
    }

    fn has_exited(&self, role: MemberRole) -> bool {
        self.children.get(&role).is_none_or(|child| child.status.is_some())
    }

    fn memory_bytes(&self, role: MemberRole) -> Option<u64> {
        self.children.get(&role).map(|_| 1 << 20)
    }

    fn cpu_s(&self, role: MemberRole) -> Option<f64> {
        self.children.get(&role).map(|child| 0.6 * (self.time - child.spawned).as_secs_f64())
    }

    fn next_event(&mut self, timeout: Duration) -> Option<SupervisorEvent> {
        self.history.borrow_mut().end_turn();
        if self.draw.strikes(FaultKind::Pause, self.time) {
            let pause = self.draw.millis(100, 20_000);
            self.record(|| format!("the orchestrator is suspended for {pause:?}"));
            self.history.borrow_mut().pauses += pause;
            self.pass(self.time + pause, |_| false);
        }
        self.pass(self.time + timeout, |world| !world.inbox.is_empty());
        self.update_clock();
        let (event, meaning) = self.inbox.pop_front()?;
        self.history.borrow_mut().on_event(&event, meaning, self.clock);
        Some(event)
    }

    fn update_clock(&mut self) {
        self.clock += (self.time - self.clock_updated).min(MAX_TICK);
        self.clock_updated = self.time;
    }

    fn now(&self) -> Duration {
        self.clock
    }

    fn free_memory(&mut self) -> bool {
        self.history.borrow_mut().has_garbage = false;
        if self.has_exited(MemberRole::Sim) {
            self.lose_services();
        }
        if !self.draw.strikes(FaultKind::SlowCleanup, self.time) {
            return true;
        }
        let time = self.draw.millis(500, 5_000);
        self.record(|| format!("freeing memory takes {time:?}"));
        self.history.borrow_mut().pauses += time;
        self.pass(self.time + time, |_| false);
        !self.draw.chance(0.5)
    }

    fn intruder(&self) -> Option<u32> {
        if self.intruder.is_some() {
            self.history.borrow_mut().on_intruder();
        }
        self.intruder
    }

    fn shortage(&self) -> Option<Shortage> {
        self.shortage.then(|| {
            self.history.borrow_mut().on_shortage();
            Shortage::Inodes
        })
    }

    fn watch_files(&mut self, is_ready: bool) {
        (self.needs_files, self.lost_file) = (is_ready, None);
    }

    fn lost_file(&self) -> Option<PathBuf> {
        let file = self.lost_file?;
        if file != "lane.dynamic" {
            self.history.borrow_mut().on_lost_file();
        }
        Some(PathBuf::from(file))
    }

    fn oom_kills(&self) -> u64 {
        self.history.borrow().n_oom_kills.into()
    }

    fn n_cores(&self) -> u32 {
        2
    }

    fn idle_core_s(&self) -> Option<f64> {
        None
    }
}

/// Returns the line that a sim writes for an event.
pub(crate) fn sim_line(event: &SimEvent) -> String {
    serde_json::json!(event).to_string()
}

/// Returns the line that a host writes for an event.
pub(crate) fn host_line(event: &HostEvent) -> String {
    serde_json::json!(event).to_string()
}
