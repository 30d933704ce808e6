//! The envs: episodes that run side by side. An env is refilled as soon as its episode is done.

use std::collections::{HashSet, VecDeque};
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use run_config::RunConfig;
use run_config::trace::{self, Activity};

use super::episode::{RunningEpisode, Status};
use super::protocol::{Assignment, Driver, Lane, Outcome, SimConfig};
use crate::perturb::Language;

/// Control steps that an env executes before the loop serves the lanes again. It affects only the order of
/// work, never a result.
const STEP_QUANTUM: u32 = 5;

/// The state of one env.
pub(crate) enum Env {
    /// The env has no episode.
    Empty,
    /// An episode whose world has not been built yet.
    Assigned(Assignment),
    /// An episode in progress.
    Running(Box<RunningEpisode>),
}

impl Env {
    fn assignment(&self) -> Option<Assignment> {
        match self {
            Self::Empty => None,
            Self::Assigned(assignment) => Some(*assignment),
            Self::Running(episode) => Some(episode.assignment),
        }
    }
}

/// Numbers of envs that a lane uses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct LaneTally {
    /// All of them.
    pub(crate) n_used: usize,
    /// Those whose next query is due.
    pub(crate) n_ready: usize,
    /// Those that are still to be built, or have action rows to execute.
    pub(crate) n_acting: usize,
}

/// All envs, and the queues of episodes without an env.
pub(crate) struct Envs {
    envs: Vec<Env>,
    /// Number of envs that may be in use.
    limit: u32,
    /// By driver: the lanes in order, then the expert.
    queues: Vec<VecDeque<Assignment>>,
    /// Number of envs that each driver uses, in the order of the queues; counted by [`Self::refill`].
    n_used: Vec<usize>,
    /// Ids of all episodes in queues and envs.
    held: HashSet<u64>,
    run: RunConfig,
    language: Language,
    lanes: Vec<Lane>,
}

impl Envs {
    /// Creates empty envs.
    pub(crate) fn new(config: &SimConfig, language: Language) -> Self {
        Self {
            envs: (0..config.max_envs).map(|_| Env::Empty).collect(),
            limit: config.envs,
            queues: vec![VecDeque::new(); config.lanes.len() + 1],
            n_used: vec![0; config.lanes.len() + 1],
            held: HashSet::new(),
            run: config.run.clone(),
            language,
            lanes: config.lanes.clone(),
        }
    }

    /// Changes the number of envs that may be in use. Episodes in progress go on.
    pub(crate) fn set_limit(&mut self, limit: u32) {
        self.limit = limit;
    }

    /// Queues an episode, unless it is queued or in an env already.
    pub(crate) fn push(&mut self, assignment: Assignment) {
        if self.held.insert(assignment.id) {
            let driver = self.driver_idx(assignment.driver);
            self.queues[driver].push_back(assignment);
        }
    }

    /// Returns the ids of all episodes in queues and envs, in ascending order.
    pub(crate) fn held(&self) -> Vec<u64> {
        let mut held: Vec<u64> = self.held.iter().copied().collect();
        held.sort_unstable();
        held
    }

    /// Returns the index of a driver's queue.
    fn driver_idx(&self, driver: Driver) -> usize {
        match driver {
            Driver::Lane(lane) => lane as usize,
            Driver::Expert => self.queues.len() - 1,
        }
    }

    /// Assigns queued episodes to empty envs. The next env goes to the driver with the fewest, so that a
    /// slow policy does not starve the others. A lane for which `is_connected` is false comes last, and gives
    /// an env back to a driver that has none.
    pub(crate) fn refill(&mut self, is_connected: impl Fn(usize) -> bool) {
        if self.queues.iter().all(VecDeque::is_empty) {
            return;
        }
        let expert = self.queues.len() - 1;
        let can_act = |driver: usize| driver == expert || is_connected(driver);
        self.n_used.fill(0);
        for env in &self.envs {
            if let Some(assignment) = env.assignment() {
                let driver = self.driver_idx(assignment.driver);
                self.n_used[driver] += 1;
            }
        }
        let room = (self.limit as usize).saturating_sub(self.n_used.iter().sum());
        for env in self.envs.iter_mut().filter(|env| matches!(env, Env::Empty)).take(room) {
            let waiting = (0..self.queues.len()).filter(|&driver| !self.queues[driver].is_empty());
            let next = waiting.min_by_key(|&driver| (!can_act(driver), self.n_used[driver]));
            let Some(driver) = next else { return };
            *env = self.queues[driver].pop_front().map_or(Env::Empty, Env::Assigned);
            self.n_used[driver] += 1;
        }
        for driver in 0..self.queues.len() {
            if can_act(driver) && self.n_used[driver] == 0 && !self.queues[driver].is_empty() {
                self.reassign_env(driver, can_act);
            }
        }
    }

    /// Gives an env of a driver that cannot act to `driver`, if there is one.
    fn reassign_env(&mut self, driver: usize, can_act: impl Fn(usize) -> bool) {
        for idx in (0..self.envs.len()).rev() {
            let Some(loser) = self.envs[idx].assignment() else { continue };
            let from = self.driver_idx(loser.driver);
            if can_act(from) {
                continue;
            }
            if let Some(winner) = self.queues[driver].pop_front() {
                self.envs[idx] = Env::Assigned(winner);
                self.queues[from].push_front(loser);
            }
            return;
        }
    }

    /// Puts the unfinished episodes of a lane's policy back into its queue. They will start from their
    /// beginning.
    pub(crate) fn restart(&mut self, lane: u32) {
        for env in self.envs.iter_mut().rev() {
            let is_done = matches!(env, Env::Running(episode) if episode.status() == Status::Done);
            if let Some(assignment) = env.assignment()
                && assignment.driver == Driver::Lane(lane)
                && !is_done
            {
                self.queues[lane as usize].push_front(assignment);
                *env = Env::Empty;
            }
        }
    }

    /// Forgets all episodes of a lane's policy.
    pub(crate) fn give_up(&mut self, lane: u32) {
        for env in &mut self.envs {
            if let Some(assignment) = env.assignment()
                && assignment.driver == Driver::Lane(lane)
            {
                self.held.remove(&assignment.id);
                *env = Env::Empty;
            }
        }
        for assignment in self.queues[lane as usize].drain(..) {
            self.held.remove(&assignment.id);
        }
    }

    /// Returns the episode that runs in an env.
    pub(crate) fn episode_mut(&mut self, slot: u32) -> Option<&mut RunningEpisode> {
        match self.envs.get_mut(slot as usize) {
            Some(Env::Running(episode)) => Some(episode),
            _ => None,
        }
    }

    /// Returns the episode that runs in an env.
    pub(crate) fn episode(&self, slot: u32) -> Option<&RunningEpisode> {
        match self.envs.get(slot as usize) {
            Some(Env::Running(episode)) => Some(episode),
            _ => None,
        }
    }

    /// Returns the envs of a lane whose next query is due, in the order of their numbers.
    pub(crate) fn ready(&self, lane: u32) -> impl Iterator<Item = (u32, &RunningEpisode)> {
        (0_u32..).zip(&self.envs).filter_map(move |(idx, env)| match env {
            Env::Running(episode) if episode.assignment.driver == Driver::Lane(lane) => {
                (episode.status() == Status::Ready).then_some((idx, episode.as_ref()))
            }
            _ => None,
        })
    }

    /// Counts the envs of a lane.
    pub(crate) fn tally(&self, lane: u32) -> LaneTally {
        let mut tally = LaneTally::default();
        for env in &self.envs {
            let (driver, status) = match env {
                Env::Empty => continue,
                Env::Assigned(assignment) => (assignment.driver, Status::Acting),
                Env::Running(episode) => (episode.assignment.driver, episode.status()),
            };
            if driver == Driver::Lane(lane) {
                tally.n_used += 1;
                tally.n_ready += usize::from(status == Status::Ready);
                tally.n_acting += usize::from(status == Status::Acting);
            }
        }
        tally
    }

    /// Returns `true` if [`Self::advance`] would build or step anything, or a finished episode has not been
    /// reported.
    pub(crate) fn has_work(&self) -> bool {
        self.envs.iter().any(|env| match env {
            Env::Empty => false,
            Env::Assigned(_) => true,
            Env::Running(episode) => matches!(episode.status(), Status::Acting | Status::Done),
        })
    }

    /// Builds assigned episodes and steps those that have action rows, envs in parallel. A thread that finds
    /// no other env goes on with its own until all have finished, instead of waiting for them. Returns the
    /// number of control steps executed.
    pub(crate) fn advance(&mut self) -> u64 {
        let (lanes, run, language) = (&self.lanes, &self.run, &self.language);
        let (unstarted, unfinished) = (AtomicUsize::new(self.envs.len()), AtomicUsize::new(self.envs.len()));
        let advance_env = |env: &mut Env| {
            unstarted.fetch_sub(1, Ordering::Relaxed);
            if let Env::Assigned(assignment) = env {
                let building = trace::span(Activity::Build);
                let episode = RunningEpisode::new(*assignment, lanes, run, language);
                building.finish(1);
                *env = Env::Running(Box::new(episode));
            }
            let start = trace::now();
            let mut advance = |max_rows| match env {
                Env::Running(episode) => u64::from(episode.advance(max_rows)),
                Env::Empty | Env::Assigned(_) => 0,
            };
            let mut n_steps = advance(STEP_QUANTUM);
            unfinished.fetch_sub(1, Ordering::Relaxed);
            while unstarted.load(Ordering::Relaxed) == 0 && unfinished.load(Ordering::Relaxed) > 0 {
                match advance(1) {
                    0 => break,
                    n => n_steps += n,
                }
            }
            if n_steps > 0 {
                trace::record(Activity::Step, start, n_steps);
            }
            n_steps
        };
        self.envs.par_iter_mut().with_max_len(1).map(advance_env).sum()
    }

    /// Reports and removes finished episodes, in the order of their numbers.
    pub(crate) fn take_finished(&mut self, mut report: impl FnMut(Outcome)) {
        for env in &mut self.envs {
            if let Env::Running(episode) = env
                && episode.status() == Status::Done
            {
                self.held.remove(&episode.assignment.id);
                report(episode.outcome());
                *env = Env::Empty;
            }
        }
    }
}
