//! The report of a run: a table and a few lines for people, or one JSON object for programs.

mod cell;
mod changes;
mod fps;
mod json;
pub(crate) mod stopping;

use self::cell::effects;
pub(crate) use self::cell::{Cell, cells};
pub(crate) use self::fps::Fps;
pub(crate) use self::json::json;
use crate::console::table::{Align, TextTable};
use crate::plan::RunPlan;
use crate::run::stopping::SequentialCell;
use crate::store::results::Column;

/// Formats the results as text tables. `conclusions` are those of a comparison that ended cells early.
pub(crate) fn table(plan: &RunPlan, cells: &[Cell], conclusions: &[SequentialCell]) -> String {
    use Align::{Left, Right};
    let columns = [
        ("policy", Left),
        ("task", Left),
        ("perturbation", Left),
        ("n", Right),
        (Column::SuccessOnce.name(), Right),
        ("95 % interval", Right),
        (Column::SuccessAtEnd.name(), Right),
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
