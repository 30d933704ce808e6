//! Running success rates of a run, for the progress display.

use crate::plan::RunPlan;
use crate::run::stopping::Stopping;
use crate::statistics::{Z95, wilson_interval};
use crate::store::results::{Results, StoreError};

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
