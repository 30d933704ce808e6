//! The episodes that have not been assigned to a sim yet.

use std::collections::VecDeque;

use super::IsWanted;
use crate::jobs::Job;

/// A queue from which unwanted jobs disappear.
pub(super) struct JobQueue<'a> {
    pending: VecDeque<Job>,
    is_wanted: &'a IsWanted<'a>,
}

impl<'a> JobQueue<'a> {
    pub(super) fn new(jobs: Vec<Job>, is_wanted: &'a IsWanted<'a>) -> Self {
        Self { pending: jobs.into(), is_wanted }
    }

    /// Returns the next job that is wanted now.
    pub(super) fn next(&mut self) -> Option<Job> {
        loop {
            let job = self.pending.pop_front()?;
            if (self.is_wanted)(&job) {
                return Some(job);
            }
        }
    }

    /// Returns `true` if no job is left, wanted or not.
    pub(super) fn is_empty(&self) -> bool {
        self.pending.is_empty()
    }
}
