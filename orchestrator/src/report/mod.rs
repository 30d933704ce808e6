//! What a run found, for people (a table and a few lines) and for programs (one JSON object).

mod changes;
mod fps;
mod json;
mod table;
mod wilson;

use std::io::{self, Write};

pub(crate) use self::fps::Fps;
pub(crate) use self::json::json;
pub(crate) use self::table::{Align, Table};
use self::wilson::wilson95;
use crate::plan::{Condition, RunPlan};
use crate::policy::NamedPolicy;
use crate::results::{CellSums, Results, StoreError};

/// Results of one policy under one condition.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Cell {
    /// Name of the policy.
    pub(crate) policy: String,
    pub(crate) condition: Condition,
    pub(crate) sums: CellSums,
}

/// Results of the whole plan, by policy, task and perturbation.
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
    /// Fraction of episodes with success after any step; none without episodes.
    pub(crate) fn success_once(&self) -> Option<f64> {
        self.per_episode(u64::from(self.sums.success_once))
    }

    /// Fraction of episodes with success after the last step; none without episodes.
    pub(crate) fn success_at_end(&self) -> Option<f64> {
        self.per_episode(u64::from(self.sums.success_at_end))
    }

    /// Mean control steps of an episode; none without episodes.
    pub(crate) fn mean_steps(&self) -> Option<f64> {
        self.per_episode(self.sums.steps)
    }

    /// 95 % interval of `success_once` by Wilson's score; none without episodes.
    pub(crate) fn wilson95(&self) -> Option<[f64; 2]> {
        wilson95(self.sums.success_once, self.sums.n)
    }

    fn per_episode(&self, sum: u64) -> Option<f64> {
        (self.sums.n > 0).then(|| sum as f64 / f64::from(self.sums.n))
    }
}

/// The table.
pub(crate) fn table(plan: &RunPlan, cells: &[Cell]) -> String {
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
    let mut table = Table::new(&columns);
    for cell in cells {
        let interval = |[low, high]: [f64; 2]| format!("{:.1} – {:.1} %", 100.0 * low, 100.0 * high);
        table.row(vec![
            cell.policy.clone(),
            cell.condition.task.name().to_owned(),
            cell.condition.perturbation.name(),
            cell.sums.n.to_string(),
            or_dash(cell.success_once().map(percent)),
            or_dash(cell.wilson95().map(interval)),
            or_dash(cell.success_at_end().map(percent)),
            or_dash(cell.mean_steps().map(|steps| format!("{steps:.1}"))),
            cell.sums.errors.to_string(),
        ]);
    }
    let mut text = table.to_string() + &changes::table(&changes::effects(cells));
    for policy in plan.policies.iter().filter(|policy| policy.runs_in_sim()) {
        text += &format!(
            "{}: the scripted expert, with privileged state; a ceiling, not a policy\n",
            policy.name
        );
    }
    text
}

/// Writes to stdout. A reader that has closed it (`| head`) has read enough.
///
/// # Errors
/// If stdout cannot be written for another reason.
pub(crate) fn print_out(text: &str) -> io::Result<()> {
    match io::stdout().lock().write_all(text.as_bytes()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        result => result,
    }
}

#[cfg(test)]
mod tests;
