//! The display of a run in progress: its progress and its success rates so far.

use crate::console::progress::Progress;
use crate::fleet::FleetEvent;
use crate::plan::RunPlan;
use crate::run::stopping::Stopping;
use crate::statistics::{Z95, wilson_interval};
use crate::store::results::{Results, StoreError};

/// The display of a run.
#[derive(Debug)]
pub(crate) struct LiveView {
    progress: Progress,
    success: RunningSuccess,
    /// Jobs that were dropped since the display was updated.
    n_skipped: u64,
}

impl LiveView {
    pub(crate) fn new(progress: Progress, success: RunningSuccess) -> Self {
        Self { progress, success, n_skipped: 0 }
    }

    /// Shows an event.
    pub(crate) fn on_event(&mut self, event: &FleetEvent<'_>, stopping: Option<&Stopping>) {
        match event {
            FleetEvent::EpisodeFinished(job, outcome) => {
                self.success.add(job.policy_idx, outcome.success());
                self.progress.skip(std::mem::take(&mut self.n_skipped));
                self.progress.status(&self.success.parts(stopping));
                self.progress.tick();
            }
            FleetEvent::Counters(counters) => self.progress.counters(counters),
            FleetEvent::Log(line) => self.progress.log(line),
            FleetEvent::RendererReady(_) | FleetEvent::Spans(..) => {}
        }
    }

    /// Counts a job that was dropped.
    pub(crate) fn on_skipped(&mut self) {
        self.n_skipped += 1;
    }

    /// Removes the display.
    pub(crate) fn finish(&self) {
        self.progress.finish();
    }
}

/// Successes so far, by policy.
#[derive(Debug)]
pub(crate) struct RunningSuccess {
    policies: Vec<PolicyTally>,
}

#[derive(Debug)]
struct PolicyTally {
    name: String,
    successes: u32,
    n: u32,
    errors: u32,
}

impl RunningSuccess {
    /// Starts with the episodes of the plan that the results file already has.
    ///
    /// # Errors
    /// If they cannot be read.
    pub(crate) fn new(plan: &RunPlan, results: &Results) -> Result<Self, StoreError> {
        let tally = |name: &String| {
            let mut tally = PolicyTally { name: name.clone(), successes: 0, n: 0, errors: 0 };
            for (condition, episode, success) in results.successes(name)? {
                // Errored episodes are run again.
                if success.is_some() && episode < plan.episodes && plan.conditions.contains(&condition) {
                    tally.add(success);
                }
            }
            Ok(tally)
        };
        let policies = plan.policies.iter().map(|policy| tally(&policy.name)).collect::<Result<_, _>>()?;
        Ok(Self { policies })
    }

    /// Counts a finished episode; `success` is `None` if it could not be run.
    pub(crate) fn add(&mut self, policy_idx: usize, success: Option<bool>) {
        self.policies[policy_idx].add(success);
    }

    /// Returns one text per policy, and one for the comparison that ends cells early.
    pub(crate) fn parts(&self, stopping: Option<&Stopping>) -> Vec<String> {
        let undecided = stopping.map(|stopping| {
            let (decided, all) = stopping.n_decided();
            format!("{} of {all} cells undecided", all - decided)
        });
        let shown = self.policies.iter().filter(|tally| tally.n + tally.errors > 0).map(PolicyTally::text);
        shown.chain(undecided).collect()
    }
}

impl PolicyTally {
    fn add(&mut self, success: Option<bool>) {
        match success {
            Some(success) => {
                self.n += 1;
                self.successes += u32::from(success);
            }
            None => self.errors += 1,
        }
    }

    fn text(&self) -> String {
        let Self { name, successes, n, errors } = self;
        let errors = if *errors > 0 { format!(", {errors} errors") } else { String::new() };
        match wilson_interval(*successes, *n, Z95) {
            Some([low, high]) => format!(
                "{name} {:.1} % ({:.1} – {:.1}) of {n}{errors}",
                100.0 * f64::from(*successes) / f64::from(*n),
                100.0 * low,
                100.0 * high,
            ),
            None => format!("{name} –{errors}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_show_rate_interval_and_errors() {
        let tally = |name: &str| PolicyTally { name: name.to_owned(), successes: 0, n: 0, errors: 0 };
        let mut running = RunningSuccess { policies: vec![tally("act"), tally("idle")] };
        (0..10).for_each(|episode| running.add(0, Some(episode < 8)));
        running.add(0, None);
        assert_eq!(running.parts(None), ["act 80.0 % (49.0 – 94.3) of 10, 1 errors"]);
    }
}
