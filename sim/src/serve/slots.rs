//! The slots: episodes that run side by side. A slot is refilled as soon as its episode is done.

use std::collections::VecDeque;

use ipc_types::RunConfig;
use rayon::prelude::*;

use super::episode::{RunningEpisode, Status};
use super::protocol::{Assignment, Driver, Lane, Outcome};
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

/// All slots, and the queue of episodes without a slot.
pub(super) struct Slots {
    slots: Vec<Slot>,
    queue: VecDeque<Assignment>,
    run: RunConfig,
    /// Paraphrases that replace the built-in ones.
    sentences: Option<Sentences>,
    /// [`Lane::images`] of every lane.
    images: Vec<bool>,
}

impl Slots {
    /// Creates empty slots, one per env of the run.
    pub(super) fn new(run: RunConfig, sentences: Option<Sentences>, lanes: &[Lane]) -> Self {
        Self {
            slots: (0..run.resources.envs).map(|_| Slot::Empty).collect(),
            queue: VecDeque::new(),
            run,
            sentences,
            images: lanes.iter().map(|lane| lane.images).collect(),
        }
    }

    /// Queues an episode.
    pub(super) fn push(&mut self, assignment: Assignment) {
        self.queue.push_back(assignment);
    }

    /// Assigns queued episodes to empty slots, first in, first out.
    pub(super) fn refill(&mut self) {
        for slot in self.slots.iter_mut().filter(|slot| matches!(slot, Slot::Empty)) {
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

    /// Returns `true` if [`Self::advance`] would build or step anything, or a finished episode has not been
    /// reported.
    pub(super) fn has_work(&self) -> bool {
        self.slots.iter().any(|slot| match slot {
            Slot::Empty => false,
            Slot::Assigned(_) => true,
            Slot::Running(episode) => matches!(episode.status(), Status::Acting | Status::Done),
        })
    }

    /// Builds assigned episodes and steps those that have action rows, slots in parallel. Returns the number
    /// of control steps executed.
    pub(super) fn advance(&mut self) -> u64 {
        let (run, sentences, images) = (&self.run, self.sentences.as_ref(), &self.images);
        let advance_slot = |slot: &mut Slot| {
            if let Slot::Assigned(assignment) = slot {
                let uses_images = match assignment.driver {
                    Driver::Lane(lane) => images[lane as usize],
                    Driver::Expert => false,
                };
                let episode = RunningEpisode::new(*assignment, run, sentences, uses_images);
                *slot = Slot::Running(Box::new(episode));
            }
            match slot {
                Slot::Running(episode) => u64::from(episode.advance(STEP_QUANTUM)),
                Slot::Empty | Slot::Assigned(_) => 0,
            }
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
