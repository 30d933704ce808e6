//! The slots: episodes that run side by side. A slot is refilled as soon as its episode is done.

use std::collections::{HashSet, VecDeque};
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use run_config::RunConfig;
use run_config::trace::{self, Activity};

use super::episode::{RunningEpisode, Status};
use super::protocol::{Assignment, Driver, Outcome, SimConfig};
use crate::perturb::Sentences;

/// Control steps that a slot executes before the loop serves the lanes again. It affects only the order of
/// work, never a result.
const STEP_QUANTUM: u32 = 5;

/// The state of one slot.
pub(crate) enum Slot {
    /// The slot has no episode.
    Empty,
    /// An episode whose world has not been built yet.
    Assigned(Assignment),
    /// An episode in progress.
    Running(Box<RunningEpisode>),
}

impl Slot {
    fn assignment(&self) -> Option<Assignment> {
        match self {
            Self::Empty => None,
            Self::Assigned(assignment) => Some(*assignment),
            Self::Running(episode) => Some(episode.assignment),
        }
    }
}

/// Numbers of slots that a lane uses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct LaneTally {
    /// All of them.
    pub(crate) n_used: usize,
    /// Those whose next query is due.
    pub(crate) n_ready: usize,
    /// Those that are still to be built, or have action rows to execute.
    pub(crate) n_acting: usize,
}

/// All slots, and the queues of episodes without a slot.
pub(crate) struct Slots {
    slots: Vec<Slot>,
    /// Number of slots that may be in use.
    limit: u32,
    /// By driver: the lanes in order, then the expert.
    queues: Vec<VecDeque<Assignment>>,
    /// Number of slots that each driver uses, in the order of the queues; counted by [`Self::refill`].
    n_used: Vec<usize>,
    /// Ids of all episodes in queues and slots.
    held: HashSet<u64>,
    run: RunConfig,
    /// Paraphrases that replace the built-in ones.
    sentences: Option<Sentences>,
    /// [`Lane::images`] of every lane.
    images: Vec<bool>,
}

impl Slots {
    /// Creates empty slots.
    pub(crate) fn new(config: &SimConfig, sentences: Option<Sentences>) -> Self {
        Self {
            slots: (0..config.max_envs).map(|_| Slot::Empty).collect(),
            limit: config.envs,
            queues: vec![VecDeque::new(); config.lanes.len() + 1],
            n_used: vec![0; config.lanes.len() + 1],
            held: HashSet::new(),
            run: config.run.clone(),
            sentences,
            images: config.lanes.iter().map(|lane| lane.images).collect(),
        }
    }

    /// Changes the number of slots that may be in use. Episodes in progress go on.
    pub(crate) fn set_limit(&mut self, limit: u32) {
        self.limit = limit;
    }

    /// Queues an episode, unless it is queued or in a slot already.
    pub(crate) fn push(&mut self, assignment: Assignment) {
        if self.held.insert(assignment.id) {
            let driver = self.driver_idx(assignment.driver);
            self.queues[driver].push_back(assignment);
        }
    }

    /// Returns the ids of all episodes in queues and slots, in ascending order.
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

    /// Assigns queued episodes to empty slots. The next slot goes to the driver with the fewest, so that a
    /// slow policy does not starve the others. A lane for which `is_connected` is false comes last, and gives
    /// a slot back to a driver that has none.
    pub(crate) fn refill(&mut self, is_connected: impl Fn(usize) -> bool) {
        if self.queues.iter().all(VecDeque::is_empty) {
            return;
        }
        let expert = self.queues.len() - 1;
        let can_act = |driver: usize| driver == expert || is_connected(driver);
        self.n_used.fill(0);
        for slot in &self.slots {
            if let Some(assignment) = slot.assignment() {
                let driver = self.driver_idx(assignment.driver);
                self.n_used[driver] += 1;
            }
        }
        let room = (self.limit as usize).saturating_sub(self.n_used.iter().sum());
        for slot in self.slots.iter_mut().filter(|slot| matches!(slot, Slot::Empty)).take(room) {
            let waiting = (0..self.queues.len()).filter(|&driver| !self.queues[driver].is_empty());
            let next = waiting.min_by_key(|&driver| (!can_act(driver), self.n_used[driver]));
            let Some(driver) = next else { return };
            *slot = self.queues[driver].pop_front().map_or(Slot::Empty, Slot::Assigned);
            self.n_used[driver] += 1;
        }
        for driver in 0..self.queues.len() {
            if can_act(driver) && self.n_used[driver] == 0 && !self.queues[driver].is_empty() {
                self.displace(driver, can_act);
            }
        }
    }

    /// Gives a slot of a driver that cannot act to `driver`, if there is one.
    fn displace(&mut self, driver: usize, can_act: impl Fn(usize) -> bool) {
        for idx in (0..self.slots.len()).rev() {
            let Some(loser) = self.slots[idx].assignment() else { continue };
            let from = self.driver_idx(loser.driver);
            if can_act(from) {
                continue;
            }
            if let Some(winner) = self.queues[driver].pop_front() {
                self.slots[idx] = Slot::Assigned(winner);
                self.queues[from].push_front(loser);
            }
            return;
        }
    }

    /// Puts the unfinished episodes of a lane's policy back into its queue. They will start from their
    /// beginning.
    pub(crate) fn restart(&mut self, lane: u32) {
        for slot in self.slots.iter_mut().rev() {
            let is_done = matches!(slot, Slot::Running(episode) if episode.status() == Status::Done);
            if let Some(assignment) = slot.assignment()
                && assignment.driver == Driver::Lane(lane)
                && !is_done
            {
                self.queues[lane as usize].push_front(assignment);
                *slot = Slot::Empty;
            }
        }
    }

    /// Forgets all episodes of a lane's policy.
    pub(crate) fn give_up(&mut self, lane: u32) {
        for slot in &mut self.slots {
            if let Some(assignment) = slot.assignment()
                && assignment.driver == Driver::Lane(lane)
            {
                self.held.remove(&assignment.id);
                *slot = Slot::Empty;
            }
        }
        for assignment in self.queues[lane as usize].drain(..) {
            self.held.remove(&assignment.id);
        }
    }

    /// Returns the episode that runs in a slot.
    pub(crate) fn episode_mut(&mut self, slot: u32) -> Option<&mut RunningEpisode> {
        match self.slots.get_mut(slot as usize) {
            Some(Slot::Running(episode)) => Some(episode),
            _ => None,
        }
    }

    /// Returns the episode that runs in a slot.
    pub(crate) fn episode(&self, slot: u32) -> Option<&RunningEpisode> {
        match self.slots.get(slot as usize) {
            Some(Slot::Running(episode)) => Some(episode),
            _ => None,
        }
    }

    /// Returns the slots of a lane whose next query is due, in slot order.
    pub(crate) fn ready(&self, lane: u32) -> impl Iterator<Item = (u32, &RunningEpisode)> {
        (0_u32..).zip(&self.slots).filter_map(move |(idx, slot)| match slot {
            Slot::Running(episode) if episode.assignment.driver == Driver::Lane(lane) => {
                (episode.status() == Status::Ready).then_some((idx, episode.as_ref()))
            }
            _ => None,
        })
    }

    /// Counts the slots of a lane.
    pub(crate) fn tally(&self, lane: u32) -> LaneTally {
        let mut tally = LaneTally::default();
        for slot in &self.slots {
            let (driver, status) = match slot {
                Slot::Empty => continue,
                Slot::Assigned(assignment) => (assignment.driver, Status::Acting),
                Slot::Running(episode) => (episode.assignment.driver, episode.status()),
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
        self.slots.iter().any(|slot| match slot {
            Slot::Empty => false,
            Slot::Assigned(_) => true,
            Slot::Running(episode) => matches!(episode.status(), Status::Acting | Status::Done),
        })
    }

    /// Builds assigned episodes and steps those that have action rows, slots in parallel. A thread that finds
    /// no other slot goes on with its own until all have finished, instead of waiting for them. Returns the
    /// number of control steps executed.
    pub(crate) fn advance(&mut self) -> u64 {
        let (run, sentences, images) = (&self.run, self.sentences.as_ref(), &self.images);
        let (unstarted, unfinished) =
            (AtomicUsize::new(self.slots.len()), AtomicUsize::new(self.slots.len()));
        let advance_slot = |slot: &mut Slot| {
            unstarted.fetch_sub(1, Ordering::Relaxed);
            if let Slot::Assigned(assignment) = slot {
                let uses_images = match assignment.driver {
                    Driver::Lane(lane) => images[lane as usize],
                    Driver::Expert => false,
                };
                let building = trace::span(Activity::Build);
                let episode = RunningEpisode::new(*assignment, run, sentences, uses_images);
                building.finish(1);
                *slot = Slot::Running(Box::new(episode));
            }
            let start = trace::now();
            let mut advance = |max_rows| match slot {
                Slot::Running(episode) => u64::from(episode.advance(max_rows)),
                Slot::Empty | Slot::Assigned(_) => 0,
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
        self.slots.par_iter_mut().with_max_len(1).map(advance_slot).sum()
    }

    /// Reports and removes finished episodes, in slot order.
    pub(crate) fn take_finished(&mut self, mut report: impl FnMut(Outcome)) {
        for slot in &mut self.slots {
            if let Slot::Running(episode) = slot
                && episode.status() == Status::Done
            {
                self.held.remove(&episode.assignment.id);
                report(episode.outcome());
                *slot = Slot::Empty;
            }
        }
    }
}
