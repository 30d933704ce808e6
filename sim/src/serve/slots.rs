//! The slots: episodes that run side by side. A slot is refilled as soon as its episode is done.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicUsize, Ordering};

use ipc_types::RunConfig;
use ipc_types::trace::{self, Activity};
use rayon::prelude::*;

use super::episode::{RunningEpisode, Status};
use super::protocol::{Assignment, Driver, Outcome, SimConfig};
use crate::perturb::Sentences;

/// Control steps that a slot executes before the loop serves the lanes again. It affects only the order of
/// work, never a result.
const STEP_QUANTUM: u32 = 5;

/// The state of one slot.
pub(super) enum Slot {
    /// The slot has no episode.
    Empty,
    /// An episode whose world has not been built yet.
    Assigned(Assignment),
    /// An episode in progress.
    Running(Box<RunningEpisode>),
}

/// Numbers of slots that a lane uses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct LaneTally {
    /// All of them.
    pub(super) n_used: usize,
    /// Those whose next query is due.
    pub(super) n_ready: usize,
    /// Those that are still to be built, or have action rows to execute.
    pub(super) n_acting: usize,
}

/// All slots, and the queue of episodes without a slot.
pub(super) struct Slots {
    slots: Vec<Slot>,
    /// Number of slots that may be in use.
    limit: u32,
    queue: VecDeque<Assignment>,
    run: RunConfig,
    /// Paraphrases that replace the built-in ones.
    sentences: Option<Sentences>,
    /// [`Lane::images`] of every lane.
    images: Vec<bool>,
}

impl Slots {
    /// Creates empty slots.
    pub(super) fn new(config: &SimConfig, sentences: Option<Sentences>) -> Self {
        Self {
            slots: (0..config.max_envs).map(|_| Slot::Empty).collect(),
            limit: config.envs,
            queue: VecDeque::new(),
            run: config.run.clone(),
            sentences,
            images: config.lanes.iter().map(|lane| lane.images).collect(),
        }
    }

    /// Changes the number of slots that may be in use. Episodes in progress go on.
    pub(super) fn set_limit(&mut self, limit: u32) {
        self.limit = limit;
    }

    /// Queues an episode.
    pub(super) fn push(&mut self, assignment: Assignment) {
        self.queue.push_back(assignment);
    }

    /// Assigns queued episodes to empty slots, first in, first out.
    pub(super) fn refill(&mut self) {
        if self.queue.is_empty() {
            return;
        }
        let n_used = self.slots.iter().filter(|slot| !matches!(slot, Slot::Empty)).count();
        let room = (self.limit as usize).saturating_sub(n_used);
        for slot in self.slots.iter_mut().filter(|slot| matches!(slot, Slot::Empty)).take(room) {
            let Some(assignment) = self.queue.pop_front() else { return };
            *slot = Slot::Assigned(assignment);
        }
    }

    /// Restarts all running episodes of a lane's policy from their beginning.
    pub(super) fn restart(&mut self, lane: u32) {
        for slot in &mut self.slots {
            if let Slot::Running(episode) = slot
                && episode.assignment.driver == Driver::Lane(lane)
            {
                *slot = Slot::Assigned(episode.assignment);
            }
        }
    }

    /// Returns the episode that runs in a slot.
    pub(super) fn episode_mut(&mut self, slot: u32) -> Option<&mut RunningEpisode> {
        match self.slots.get_mut(slot as usize) {
            Some(Slot::Running(episode)) => Some(episode),
            _ => None,
        }
    }

    /// Returns the episode that runs in a slot.
    pub(super) fn episode(&self, slot: u32) -> Option<&RunningEpisode> {
        match self.slots.get(slot as usize) {
            Some(Slot::Running(episode)) => Some(episode),
            _ => None,
        }
    }

    /// Returns the slots of a lane whose next query is due, in slot order.
    pub(super) fn ready(&self, lane: u32) -> impl Iterator<Item = (u32, &RunningEpisode)> {
        (0_u32..).zip(&self.slots).filter_map(move |(idx, slot)| match slot {
            Slot::Running(episode) if episode.assignment.driver == Driver::Lane(lane) => {
                (episode.status() == Status::Ready).then_some((idx, episode.as_ref()))
            }
            _ => None,
        })
    }

    /// Counts the slots of a lane.
    pub(super) fn tally(&self, lane: u32) -> LaneTally {
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
    pub(super) fn has_work(&self) -> bool {
        self.slots.iter().any(|slot| match slot {
            Slot::Empty => false,
            Slot::Assigned(_) => true,
            Slot::Running(episode) => matches!(episode.status(), Status::Acting | Status::Done),
        })
    }

    /// Builds assigned episodes and steps those that have action rows, slots in parallel. A thread that finds
    /// no other slot goes on with its own until all have finished, instead of waiting for them. Returns the
    /// number of control steps executed.
    pub(super) fn advance(&mut self) -> u64 {
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
    pub(super) fn take_finished(&mut self, mut report: impl FnMut(Outcome)) {
        for slot in &mut self.slots {
            if let Slot::Running(episode) = slot
                && episode.status() == Status::Done
            {
                report(episode.outcome());
                *slot = Slot::Empty;
            }
        }
    }
}
