//! The episodes that have not been assigned to a sim yet.

use std::collections::VecDeque;

use sim::serve::protocol::Driver;

use super::IsWanted;
use crate::jobs::Job;

/// A queue from which unwanted jobs disappear. Each driver has a limit of its own, so that one that does not
/// finish its episodes holds nobody else up.
pub(super) struct JobQueue<'a> {
    drivers: Vec<DriverQueue>,
    is_wanted: &'a IsWanted<'a>,
}

/// The jobs of one driver.
struct DriverQueue {
    driver: Driver,
    /// With their positions in the plan.
    pending: VecDeque<(usize, Job)>,
    /// Number of jobs that were taken and have not finished.
    n_outstanding: usize,
}

impl DriverQueue {
    fn is_active(&self) -> bool {
        self.n_outstanding > 0 || !self.pending.is_empty()
    }
}

impl<'a> JobQueue<'a> {
    pub(super) fn new(jobs: Vec<Job>, is_wanted: &'a IsWanted<'a>) -> Self {
        let mut drivers: Vec<DriverQueue> = Vec::new();
        for (position, job) in jobs.into_iter().enumerate() {
            let known = drivers.iter().position(|queue| queue.driver == job.driver);
            let idx = known.unwrap_or_else(|| {
                let pending = VecDeque::new();
                drivers.push(DriverQueue { driver: job.driver, pending, n_outstanding: 0 });
                drivers.len() - 1
            });
            drivers[idx].pending.push_back((position, job));
        }
        Self { drivers, is_wanted }
    }

    /// Takes the next job that is wanted now, in the order of the plan. Skips the drivers that have work for
    /// all `envs` envs, and their share of as many ahead of time.
    pub(super) fn next(&mut self, envs: usize) -> Option<Job> {
        let n_active = self.drivers.iter().filter(|queue| queue.is_active()).count();
        let limit = envs + envs.div_ceil(n_active.max(1));
        loop {
            let open = self.drivers.iter_mut().filter(|queue| queue.n_outstanding < limit);
            let queue =
                open.filter(|queue| !queue.pending.is_empty()).min_by_key(|queue| queue.pending[0].0)?;
            let (_, job) = queue.pending.pop_front()?;
            if (self.is_wanted)(&job) {
                queue.n_outstanding += 1;
                return Some(job);
            }
        }
    }

    /// Records that a job has finished.
    pub(super) fn on_finished(&mut self, driver: Driver) {
        if let Some(queue) = self.drivers.iter_mut().find(|queue| queue.driver == driver) {
            queue.n_outstanding = queue.n_outstanding.saturating_sub(1);
        }
    }

    /// Takes all jobs of a driver that are wanted now.
    pub(super) fn take_all(&mut self, driver: Driver) -> Vec<Job> {
        let queue = self.drivers.iter_mut().find(|queue| queue.driver == driver);
        let jobs = queue.map(|queue| std::mem::take(&mut queue.pending)).unwrap_or_default();
        jobs.into_iter().map(|(_, job)| job).filter(|job| (self.is_wanted)(job)).collect()
    }

    /// Returns the number of drivers that have had jobs.
    pub(super) fn n_drivers(&self) -> usize {
        self.drivers.len()
    }

    /// Returns `true` if no job is left, wanted or not.
    pub(super) fn is_empty(&self) -> bool {
        self.drivers.iter().all(|queue| queue.pending.is_empty())
    }
}
