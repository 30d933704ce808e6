//! A simulated sim: it holds episodes, runs them in virtual time, and reports as the real one does.

use std::collections::BTreeMap;
use std::time::Duration;

use sim::serve::protocol::{
    Assignment, Counters, Driver, EpisodeLedger, Outcome, SimCommand, SimConfig, SimEvent,
};
use xxhash_rust::xxh3::xxh3_64;

use super::injector::FaultInjector;
use super::scenario::FaultScenario;

/// The intervals of the real sim.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(100);
const WAITING_INTERVAL: Duration = Duration::from_secs(1);
/// Virtual time of a control step.
const STEP: Duration = Duration::from_millis(20);

/// The host that a lane's shared memory connects the sim to.
#[derive(Clone, Copy)]
pub(crate) struct LaneHost {
    pub(crate) id: u64,
    pub(crate) answers: bool,
    pub(crate) is_slow: bool,
}

pub(crate) struct FakeSim {
    lanes: Vec<FakeLane>,
    /// All unfinished episodes, by assignment id.
    episodes: BTreeMap<u64, FakeEpisode>,
    /// Maximum number of episodes that run.
    limit: usize,
    foreign_timeout: Duration,
    longest_ms: u64,
    counters: Counters,
    last_tick: Duration,
    last_progress: Duration,
    last_work: Duration,
    /// `true` once no episode proceeds any more, which the sim does not notice.
    pub(crate) is_stalled: bool,
}

struct FakeLane {
    policy: String,
    foreign: bool,
    answer_timeout: Duration,
    connected: bool,
    /// The foreign host that receives the queries.
    host: Option<u64>,
    absent_since: Option<Duration>,
    given_up: bool,
    /// Queries that were answered since the host was told.
    answered: u64,
}

struct FakeEpisode {
    assignment: Assignment,
    run: Option<EpisodeRun>,
}

struct EpisodeRun {
    remaining: Duration,
    /// The host that has the query.
    host: Option<u64>,
    /// Time of the last answer.
    answered: Duration,
}

impl FakeSim {
    pub(crate) fn new(config: &SimConfig, scenario: &FaultScenario) -> Self {
        let lane = |lane: &sim::serve::protocol::Lane| FakeLane {
            policy: lane.spec.policy.clone(),
            foreign: lane.foreign,
            answer_timeout: Duration::from_secs(lane.answer_timeout_s.into()),
            connected: false,
            host: None,
            absent_since: None,
            given_up: false,
            answered: 0,
        };
        Self {
            lanes: config.lanes.iter().map(lane).collect(),
            episodes: BTreeMap::new(),
            limit: config.envs as usize,
            foreign_timeout: scenario.config.limits.foreign,
            longest_ms: scenario.longest_ms,
            counters: Counters::default(),
            last_tick: Duration::ZERO,
            last_progress: Duration::ZERO,
            last_work: Duration::ZERO,
            is_stalled: false,
        }
    }

    /// Records that the sim has become ready.
    pub(crate) fn on_ready(&mut self, now: Duration) {
        (self.last_tick, self.last_progress, self.last_work) = (now, now, now);
    }

    pub(crate) fn progress(&self) -> SimEvent {
        SimEvent::Progress(self.counters.clone())
    }

    /// Takes the number of queries that a lane's host has answered.
    pub(crate) fn take_answered(&mut self, lane: usize) -> u64 {
        std::mem::take(&mut self.lanes[lane].answered)
    }

    pub(crate) fn handle(&mut self, command: &SimCommand, hosts: &[Option<LaneHost>]) {
        match *command {
            SimCommand::Run(assignment) => {
                let episode = FakeEpisode { assignment, run: None };
                self.episodes.entry(assignment.id).or_insert(episode);
            }
            SimCommand::Envs { count } => self.limit = count as usize,
            SimCommand::HostUp { lane } => {
                let idx = lane as usize;
                if self.lanes[idx].connected {
                    self.drop_host(lane);
                }
                let state = &mut self.lanes[idx];
                state.host = hosts[idx].filter(|_| state.foreign).map(|host| host.id);
                state.connected = !state.foreign || state.host.is_some();
            }
            SimCommand::HostDown { lane } => self.drop_host(lane),
            SimCommand::GiveUp { lane } => {
                let state = &mut self.lanes[lane as usize];
                (state.connected, state.given_up) = (false, true);
                self.episodes.retain(|_, episode| episode.assignment.driver != Driver::Lane(lane));
            }
        }
    }

    /// Does what has become due. Episodes of a lane proceed only while its host answers.
    pub(crate) fn tick(
        &mut self,
        now: Duration,
        hosts: &[Option<LaneHost>],
        draw: &mut FaultInjector,
    ) -> Vec<SimEvent> {
        let mut events = Vec::new();
        if !self.is_stalled {
            events
                .extend((0..hosts.len()).filter_map(|lane| self.check_foreign_host(lane, now, hosts[lane])));
            if self.start_episodes(now, hosts, draw) {
                self.last_work = now;
            }
            // A suspended sim catches up on nothing.
            let step = (now - self.last_tick).min(Duration::from_millis(200));
            events.extend(self.run_episodes(now, step, hosts, draw));
        }
        self.last_tick = now;
        if now - self.last_progress >= PROGRESS_INTERVAL {
            self.last_progress = now;
            events.push(self.progress());
        }
        if now - self.last_work >= WAITING_INTERVAL {
            self.last_work = now;
            let held = self.episodes.keys().copied().collect();
            events.push(SimEvent::Waiting {
                held,
                hosts: self.lanes.iter().map(|lane| lane.connected).collect(),
            });
        }
        events
    }

    fn check_foreign_host(&mut self, idx: usize, now: Duration, host: Option<LaneHost>) -> Option<SimEvent> {
        let (state, lane) = (&mut self.lanes[idx], idx as u32);
        if !state.foreign || state.given_up {
            return None;
        }
        if let Some(host) = host {
            let is_replaced = state.host.is_some_and(|id| id != host.id);
            (state.host, state.absent_since, state.connected) = (Some(host.id), None, !is_replaced);
            return is_replaced.then(|| self.lose_host(lane));
        }
        let was_connected = state.connected;
        state.host = None;
        if now - *state.absent_since.get_or_insert(now) > self.foreign_timeout {
            state.absent_since = None;
            let message = format!("no host for policy `{}` connected", state.policy);
            self.drop_host(lane);
            return Some(SimEvent::LaneFailed { lane, message, is_final: true });
        }
        was_connected.then(|| self.lose_host(lane))
    }

    /// Returns the last events: those that a sim writes which notices first that its hosts have left.
    pub(crate) fn on_closed(&mut self, hosts: &[Option<LaneHost>]) -> Vec<SimEvent> {
        let mut events = vec![self.progress()];
        for (lane, state) in (0..).zip(&self.lanes) {
            if state.connected && !state.foreign && hosts[lane as usize].is_none() {
                let message = format!("the host of policy `{}` has left", state.policy);
                events.push(SimEvent::LaneFailed { lane, message, is_final: false });
            }
        }
        events
    }

    fn lose_host(&mut self, lane: u32) -> SimEvent {
        self.drop_host(lane);
        SimEvent::HostLost { lane }
    }

    fn drop_host(&mut self, lane: u32) {
        self.lanes[lane as usize].connected = false;
        for episode in self.episodes.values_mut() {
            if episode.assignment.driver == Driver::Lane(lane) {
                episode.run = None;
            }
        }
    }

    /// Starts as many episodes as there is room for; the next one is of the driver that has the fewest.
    /// Returns `true` if any was started.
    fn start_episodes(
        &mut self,
        now: Duration,
        hosts: &[Option<LaneHost>],
        draw: &mut FaultInjector,
    ) -> bool {
        let lane_idx = |driver| if let Driver::Lane(lane) = driver { Some(lane as usize) } else { None };
        let mut running: Vec<Driver> = Vec::new();
        let drivers = self.episodes.values().filter(|episode| episode.run.is_some());
        running.extend(drivers.map(|episode| episode.assignment.driver));
        let n_before = running.len();
        while running.len() < self.limit {
            let can_act = |driver| lane_idx(driver).is_none_or(|lane: usize| self.lanes[lane].connected);
            let waiting = self.episodes.values_mut().filter(|episode| episode.run.is_none());
            let ready = waiting.filter(|episode| can_act(episode.assignment.driver));
            let next = ready.min_by_key(|episode| {
                running.iter().filter(|driver| **driver == episode.assignment.driver).count()
            });
            let Some(episode) = next else { break };
            let driver = episode.assignment.driver;
            let host = lane_idx(driver).and_then(|lane| hosts[lane]).map(|host| host.id);
            episode.run =
                Some(EpisodeRun { remaining: draw.millis(50, self.longest_ms), host, answered: now });
            running.push(driver);
        }
        running.len() > n_before
    }

    fn run_episodes(
        &mut self,
        now: Duration,
        step: Duration,
        hosts: &[Option<LaneHost>],
        draw: &mut FaultInjector,
    ) -> Vec<SimEvent> {
        let mut failed = Vec::new();
        for FakeEpisode { assignment, run } in self.episodes.values_mut() {
            let Some(run) = run else { continue };
            if let Driver::Lane(lane) = assignment.driver {
                let (host, state) = (hosts[lane as usize], &mut self.lanes[lane as usize]);
                if !host.is_some_and(|host| host.answers && run.host == Some(host.id)) {
                    // A query without a receiver fails at once if the receiver's end is closed.
                    let has_no_peer = host.is_none() && !state.foreign && draw.chance(0.02);
                    if has_no_peer || now - run.answered > state.answer_timeout {
                        failed.push(lane);
                    }
                    continue;
                }
                run.answered = now;
                state.answered += 1;
                self.counters.queries += 1;
                if host.is_none_or(|host| !host.is_slow) {
                    self.last_work = now;
                }
            } else {
                self.last_work = now;
            }
            run.remaining = run.remaining.saturating_sub(step);
            self.counters.env_steps += step.div_duration_f64(STEP) as u64 + 1;
            self.counters.physics_s += step.as_secs_f64();
            self.counters.cpu_s += 1.5 * step.as_secs_f64();
        }
        failed.dedup();
        let mut events = Vec::new();
        for lane in failed {
            // Several episodes may wait for the same host.
            if self.lanes[lane as usize].connected {
                self.drop_host(lane);
                let message = format!("policy `{}` has not answered", self.lanes[lane as usize].policy);
                events.push(SimEvent::LaneFailed { lane, message, is_final: false });
            }
        }
        let is_done = |episode: &FakeEpisode| episode.run.as_ref().is_some_and(|run| run.remaining.is_zero());
        let done: Vec<u64> = self.episodes.iter().filter(|(_, e)| is_done(e)).map(|(id, _)| *id).collect();
        let done = done.into_iter().filter_map(|id| self.episodes.remove(&id));
        events.extend(done.map(|episode| SimEvent::Finished(Box::new(outcome(&episode.assignment)))));
        events
    }
}

/// Returns the outcome of an episode, a pure function of everything but its id.
pub(crate) fn outcome(assignment: &Assignment) -> Outcome {
    let Assignment { id, driver, task, perturbation, seed } = *assignment;
    let fingerprint = xxh3_64(format!("{driver:?} {task:?} {perturbation:?} {seed}").as_bytes());
    Outcome {
        id,
        steps: (fingerprint % 90) as u32 + 1,
        success_once: fingerprint & 1 == 1,
        success_at_end: fingerprint & 3 == 3,
        first_success_step: (fingerprint & 1 == 1).then_some(1),
        failed_predicate: (fingerprint & 3 != 3).then(|| "on_table".to_owned()),
        fingerprint,
        actions: None,
        ledger: EpisodeLedger::default(),
        error: fingerprint.is_multiple_of(7).then(|| "an action is not finite".to_owned()),
    }
}
