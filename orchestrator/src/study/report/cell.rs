//! The results of a plan, by cell: a policy under a condition.

use crate::plan::RunPlan;
use crate::run::stopping::SequentialCell;
use crate::selection::condition::Condition;
use crate::selection::policy::NamedPolicy;
use crate::statistics::{Z95, wilson_interval};
use crate::store::results::{CellSums, Results, StoreError};
use crate::study::analysis::{CellRate, Effect};

/// The results of one policy under one condition.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Cell {
    /// Name of the policy.
    pub(crate) policy: String,
    pub(crate) condition: Condition,
    pub(crate) sums: CellSums,
}

/// Reads the results of the whole plan, by policy, task and perturbation.
///
/// # Errors
/// If the results file cannot be read.
pub(crate) fn cells(plan: &RunPlan, results: &Results) -> Result<Vec<Cell>, StoreError> {
    let pairs = plan
        .policies
        .iter()
        .flat_map(|policy| plan.conditions.iter().map(move |&condition| (policy, condition)));
    let cell = |(policy, condition): (&NamedPolicy, Condition)| {
        let sums = results.sums(&policy.name, condition, plan.episodes)?;
        Ok(Cell { policy: policy.name.clone(), condition, sums })
    };
    pairs.map(cell).collect()
}

impl Cell {
    /// Returns the fraction of episodes with success after any step; `None` without episodes.
    pub(crate) fn success_once(&self) -> Option<f64> {
        self.per_episode(u64::from(self.sums.success_once))
    }

    /// Returns the fraction of episodes with success after the last step; `None` without episodes.
    pub(crate) fn success_at_end(&self) -> Option<f64> {
        self.per_episode(u64::from(self.sums.success_at_end))
    }

    /// Returns the mean number of control steps per episode; `None` without episodes.
    pub(crate) fn mean_steps(&self) -> Option<f64> {
        self.per_episode(self.sums.steps)
    }

    /// Returns the 95 % Wilson score interval of `success_once`; `None` without episodes.
    pub(crate) fn wilson95(&self) -> Option<[f64; 2]> {
        wilson_interval(self.sums.success_once, self.sums.n, Z95)
    }

    /// Returns the confidence sequence of `success_once` if the cell may have ended early: Wilson's interval
    /// holds for a fixed number of episodes only.
    pub(crate) fn sequence_interval(
        &self,
        plan: &RunPlan,
        conclusions: &[SequentialCell],
    ) -> Option<[f64; 2]> {
        let side = plan.stopping.as_ref()?.policies.iter().position(|name| *name == self.policy)?;
        let conclusion = conclusions.iter().find(|conclusion| conclusion.condition == self.condition)?;
        Some(conclusion.rates[side])
    }

    fn per_episode(&self, sum: u64) -> Option<f64> {
        (self.sums.n > 0).then(|| sum as f64 / f64::from(self.sums.n))
    }
}

/// Returns the effects of the perturbations on each policy that is not named in `stopped`.
pub(crate) fn effects(cells: &[Cell], stopped: &[String]) -> Vec<Effect> {
    fn rate(cell: &Cell) -> CellRate<'_> {
        CellRate { policy: &cell.policy, condition: cell.condition, success: cell.success_once() }
    }
    let cells = cells.iter().filter(|cell| !stopped.contains(&cell.policy));
    crate::study::analysis::effects(&cells.map(rate).collect::<Vec<_>>())
}
