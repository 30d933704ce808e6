//! The slots: episodes side by side, each refilled the moment it is done.

use std::collections::VecDeque;

use ipc_types::RunConfig;
use rayon::prelude::*;

use super::episode::{Episode, Status};
use super::protocol::{Assignment, Driver, Lane, Outcome};

/// Control steps a slot executes before the loop looks at the lanes again. It shapes only the order of work, never a result.
const STEP_QUANTUM: u32 = 5;

/// One place for an episode.
pub(super) enum Slot {
    /// Free.
    Empty,
    /// Given an episode that is not built yet.
    Assigned(Assignment),
    /// In progress.
    Running(Box<Episode>),
}

/// All slots, and the episodes that wait for one.
pub(super) struct Slots {
    slots: Vec<Slot>,
    queue: VecDeque<Assignment>,
    run: RunConfig,
    /// Per lane, whether its policy looks at images.
    images: Vec<bool>,
}

impl Slots {
    pub(super) fn new(run: RunConfig, lanes: &[Lane]) -> Self {
        Self {
            slots: (0..run.resources.envs).map(|_| Slot::Empty).collect(),
            queue: VecDeque::new(),
            run,
            images: lanes.iter().map(|lane| lane.images).collect(),
        }
    }

    /// Queues an episode.
    pub(super) fn push(&mut self, assignment: Assignment) {
        self.queue.push_back(assignment);
    }

    /// Gives free slots their next episodes, in the order they were queued.
    pub(super) fn refill(&mut self) {
        for slot in self.slots.iter_mut().filter(|slot| matches!(slot, Slot::Empty)) {
            let Some(assignment) = self.queue.pop_front() else { return };
            *slot = Slot::Assigned(assignment);
        }
    }

    /// Starts the episodes of a lane's policy again from their beginning.
    pub(super) fn restart(&mut self, lane: u32) {
        for slot in &mut self.slots {
            if let Slot::Running(episode) = slot
                && episode.assignment.driver == Driver::Lane(lane)
            {
                *slot = Slot::Assigned(episode.assignment);
            }
        }
    }

    /// The episode in a slot.
    pub(super) fn episode_mut(&mut self, slot: u32) -> Option<&mut Episode> {
        match self.slots.get_mut(slot as usize) {
            Some(Slot::Running(episode)) => Some(episode),
            _ => None,
        }
    }

    /// The episode in a slot.
    pub(super) fn episode(&self, slot: u32) -> Option<&Episode> {
        match self.slots.get(slot as usize) {
            Some(Slot::Running(episode)) => Some(episode),
            _ => None,
        }
    }

    /// Slots of a lane whose next observation is due, in slot order.
    pub(super) fn ready(&self, lane: u32) -> impl Iterator<Item = (u32, &Episode)> {
        (0_u32..).zip(&self.slots).filter_map(move |(idx, slot)| match slot {
            Slot::Running(episode) if episode.assignment.driver == Driver::Lane(lane) => {
                (episode.status() == Status::Ready).then_some((idx, episode.as_ref()))
            }
            _ => None,
        })
    }

    /// Whether a pass would build or step anything, or an episode that an answer has ended waits to be reported.
    pub(super) fn has_work(&self) -> bool {
        self.slots.iter().any(|slot| match slot {
            Slot::Empty => false,
            Slot::Assigned(_) => true,
            Slot::Running(episode) => matches!(episode.status(), Status::Acting | Status::Done),
        })
    }

    /// One pass, slots in parallel: builds what was assigned, steps what has rows. Returns the control steps executed.
    pub(super) fn pass(&mut self) -> u64 {
        let (run, images) = (&self.run, &self.images);
        let work = |slot: &mut Slot| {
            if let Slot::Assigned(assignment) = slot {
                let looks = match assignment.driver {
                    Driver::Lane(lane) => images[lane as usize],
                    Driver::Expert => false,
                };
                *slot = Slot::Running(Box::new(Episode::new(*assignment, run, looks)));
            }
            match slot {
                Slot::Running(episode) => u64::from(episode.advance(STEP_QUANTUM)),
                Slot::Empty | Slot::Assigned(_) => 0,
            }
        };
        self.slots.par_iter_mut().with_max_len(1).map(work).sum()
    }

    /// Empties the slots that are done, in slot order.
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
