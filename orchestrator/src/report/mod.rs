//! The report of a run: a table and a few lines for people, or one JSON object for programs.

mod changes;
mod fps;
mod json;
pub(crate) mod stopping;

pub(crate) use self::fps::Fps;
pub(crate) use self::json::json;
use crate::analysis::{CellRate, Effect};
use crate::plan::{Condition, RunPlan};
use crate::policy::NamedPolicy;
use crate::results::{CellSums, Results, StoreError};
use crate::statistics::{Z95, wilson_interval};
use crate::stopping::SequentialCell;
use crate::table::{Align, TextTable};

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
    fn sequence_interval(&self, plan: &RunPlan, conclusions: &[SequentialCell]) -> Option<[f64; 2]> {
        let side = plan.stopping.as_ref()?.policies.iter().position(|name| *name == self.policy)?;
        let conclusion = conclusions.iter().find(|conclusion| conclusion.condition == self.condition)?;
        Some(conclusion.rates[side])
    }

    fn per_episode(&self, sum: u64) -> Option<f64> {
        (self.sums.n > 0).then(|| sum as f64 / f64::from(self.sums.n))
    }
}

/// Returns the effects of the perturbations on each policy that is not named in `stopped`.
fn effects(cells: &[Cell], stopped: &[String]) -> Vec<Effect> {
    fn rate(cell: &Cell) -> CellRate<'_> {
        CellRate { policy: &cell.policy, condition: cell.condition, success: cell.success_once() }
    }
    let cells = cells.iter().filter(|cell| !stopped.contains(&cell.policy));
    crate::analysis::effects(&cells.map(rate).collect::<Vec<_>>())
}

/// Formats the results as text tables. `conclusions` are those of a comparison that ended cells early.
pub(crate) fn table(plan: &RunPlan, cells: &[Cell], conclusions: &[SequentialCell]) -> String {
    use Align::{Left, Right};
    let columns = [
        ("policy", Left),
        ("task", Left),
        ("perturbation", Left),
        ("n", Right),
        ("success_once", Right),
        ("95 % interval", Right),
        ("success_at_end", Right),
        ("mean_steps", Right),
        ("errors", Right),
    ];
    let percent = |fraction: f64| format!("{:.1} %", 100.0 * fraction);
    let or_dash = |text: Option<String>| text.unwrap_or_else(|| "–".to_owned());
    let mut table = TextTable::new(&columns);
    for cell in cells {
        let interval = |[low, high]: [f64; 2]| format!("{:.1} – {:.1} %", 100.0 * low, 100.0 * high);
        table.row(vec![
            cell.policy.clone(),
            cell.condition.task.name().to_owned(),
            cell.condition.perturbation.name(),
            cell.sums.n.to_string(),
            or_dash(cell.success_once().map(percent)),
            or_dash(cell.sequence_interval(plan, conclusions).or_else(|| cell.wilson95()).map(interval)),
            or_dash(cell.success_at_end().map(percent)),
            or_dash(cell.mean_steps().map(|steps| format!("{steps:.1}"))),
            cell.sums.errors.to_string(),
        ]);
    }
    let mut text = table.to_string() + &changes::table(&effects(cells, plan.stopped()));
    if let Some(rule) = &plan.stopping {
        let [a, b] = &rule.policies;
        text += &format!(
            "{a}, {b}: intervals are confidence sequences, because cells end when they are decided; there are no means over \
             such cells\n"
        );
        text += &stopping::table(rule, conclusions);
    }
    for policy in plan.policies.iter().filter(|policy| policy.runs_in_sim()) {
        text += &format!(
            "{}: the scripted expert, which reads privileged state; a ceiling, not a policy\n",
            policy.name
        );
    }
    text
}

#[cfg(test)]
mod tests;
