//! The episodes that have not been assigned to a sim yet.

use std::iter::Peekable;

use sim::serve::protocol::Driver;

use crate::plan::jobs::{DriverJobs, Job, JobList};

/// A queue from which jobs disappear that are unwanted when their turn comes. Each driver has a limit of its
/// own, so that one that does not finish its episodes holds nobody else up.
pub(crate) struct JobQueue {
    drivers: Vec<DriverQueue>,
    /// `true` if no driver may get far ahead of another that still has jobs.
    in_step: bool,
}

/// The jobs of one driver.
struct DriverQueue {
    driver: Driver,
    /// With their positions in the plan.
    pending: Peekable<DriverJobs>,
    is_empty: bool,
    /// Number of jobs that were taken and have not finished.
    n_outstanding: usize,
}

impl DriverQueue {
    fn new(driver: Driver, jobs: DriverJobs) -> Self {
        let mut queue = Self { driver, pending: jobs.peekable(), is_empty: false, n_outstanding: 0 };
        queue.is_empty = queue.pending.peek().is_none();
        queue
    }

    fn is_active(&self) -> bool {
        self.n_outstanding > 0 || !self.is_empty
    }

    /// Returns the position of the first job in the plan.
    fn first(&mut self) -> Option<u64> {
        self.pending.peek().map(|(position, _)| *position)
    }

    fn pop(&mut self) -> Option<Job> {
        let job = self.pending.next().map(|(_, job)| job);
        self.is_empty = self.pending.peek().is_none();
        job
    }
}

impl JobQueue {
    pub(crate) fn new(jobs: &JobList, in_step: bool) -> Self {
        let queues = jobs.drivers().map(|driver| DriverQueue::new(driver, jobs.of_driver(driver)));
        Self { drivers: queues.filter(|queue| !queue.is_empty).collect(), in_step }
    }

    /// Takes the next job that is wanted now, in the order of the plan. Skips the drivers that have work for
    /// all `envs` envs and their share of as many ahead of time, and those that are too far ahead of another.
    pub(crate) fn next(&mut self, envs: usize, is_wanted: &mut dyn FnMut(&Job) -> bool) -> Option<Job> {
        let n_active = self.drivers.iter().filter(|queue| queue.is_active()).count();
        let limit = envs + envs.div_ceil(n_active.max(1));
        loop {
            let ahead = (2 * limit * self.drivers.len()) as u64;
            let end = if self.in_step { self.first()?.saturating_add(ahead) } else { u64::MAX };
            let open = self.drivers.iter_mut().filter(|queue| queue.n_outstanding < limit);
            let firsts = open.filter_map(|queue| Some((queue.first().filter(|first| *first < end)?, queue)));
            let (_, queue) = firsts.min_by_key(|(first, _)| *first)?;
            let job = queue.pop()?;
            if is_wanted(&job) {
                queue.n_outstanding += 1;
                return Some(job);
            }
        }
    }

    /// Returns the position of the first job in the plan that is left.
    fn first(&mut self) -> Option<u64> {
        self.drivers.iter_mut().filter_map(DriverQueue::first).min()
    }

    /// Records that a job has finished.
    pub(crate) fn on_finished(&mut self, driver: Driver) {
        if let Some(queue) = self.drivers.iter_mut().find(|queue| queue.driver == driver) {
            queue.n_outstanding = queue.n_outstanding.saturating_sub(1);
        }
    }

    /// Takes all jobs of a driver that are wanted now.
    pub(crate) fn take_all(&mut self, driver: Driver, is_wanted: &mut dyn FnMut(&Job) -> bool) -> Vec<Job> {
        let Some(queue) = self.drivers.iter_mut().find(|queue| queue.driver == driver) else {
            return Vec::new();
        };
        std::iter::from_fn(|| queue.pop()).filter(|job| is_wanted(job)).collect()
    }

    /// Returns the number of drivers that have had jobs.
    pub(crate) fn n_drivers(&self) -> usize {
        self.drivers.len()
    }

    /// Returns `true` if no job is left, wanted or not.
    pub(crate) fn is_empty(&self) -> bool {
        self.drivers.iter().all(|queue| queue.is_empty)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::RunPlan;
    use crate::plan::sweep::SweepArgs;
    use crate::store::results::FinishedEpisodes;

    /// Finishes every job of one driver at once and none of the other. Returns the number of the former.
    fn n_of_faster(in_step: bool) -> usize {
        let arguments = "--policy idle --policy random --tasks RaiseCube --episodes 200";
        let plan = RunPlan::new(&SweepArgs::parse(arguments).unwrap()).unwrap();
        let mut queue =
            JobQueue::new(&JobList::unfinished(&plan, FinishedEpisodes::default(), None), in_step);
        let mut n_finished = 0;
        while let Some(job) = queue.next(10, &mut |_| true) {
            if job.driver == Driver::Lane(0) {
                queue.on_finished(job.driver);
                n_finished += 1;
            }
        }
        n_finished
    }

    #[test]
    fn faster_driver_waits_only_in_step() {
        assert_eq!(n_of_faster(false), 200);
        // The slower one has taken 15 jobs, and the next is at position 31: the other gets those before
        // position 31 + 2 · 15 · 2.
        assert_eq!(n_of_faster(true), 46);
    }
}
