//! Heat map of success by task and perturbation, one per policy, as an HTML table.

use serde::Serialize;
use sim::TaskId;
use sim::perturb::Composition;

use crate::study::analysis::CellSummary;
use crate::study::page::content::ReportContent;

/// The table of one policy.
#[derive(Debug, Serialize)]
pub(crate) struct HeatMap {
    policy: String,
    /// Number of episodes per cell, or its range.
    episodes: String,
    columns: Vec<String>,
    rows: Vec<HeatRow>,
}

#[derive(Debug, Serialize)]
struct HeatRow {
    task: &'static str,
    /// `None` where a perturbation does not apply or was not run.
    cells: Vec<Option<HeatCell>>,
}

#[derive(Debug, Serialize)]
struct HeatCell {
    /// Percent without decimals.
    text: String,
    /// Its interval.
    interval: String,
    /// Details shown on hover.
    title: String,
    background: String,
    color: &'static str,
}

/// Returns the heat maps of the policies under test.
pub(crate) fn heat_maps(report: &ReportContent) -> Vec<HeatMap> {
    let map = |name: &str| {
        let cells: Vec<&CellSummary> = report.cells_of(name).collect();
        let mut perturbations: Vec<Composition> =
            cells.iter().map(|cell| cell.condition.perturbation).collect();
        perturbations.sort_unstable();
        perturbations.dedup();
        let mut tasks: Vec<TaskId> = cells.iter().map(|cell| cell.condition.task).collect();
        tasks.dedup();
        let row = |task: &TaskId| HeatRow {
            task: task.name(),
            cells: perturbations
                .iter()
                .map(|perturbation| {
                    let is_here = |cell: &&CellSummary| {
                        cell.condition.task == *task && cell.condition.perturbation == *perturbation
                    };
                    cells.iter().copied().find(is_here).and_then(heat_cell)
                })
                .collect(),
        };
        let counts = || cells.iter().map(|cell| cell.rate.n);
        let episodes = match (counts().min(), counts().max()) {
            (Some(fewest), Some(most)) if fewest < most => format!("{fewest} to {most}"),
            (_, most) => most.unwrap_or(0).to_string(),
        };
        HeatMap {
            policy: name.to_owned(),
            episodes,
            columns: perturbations.iter().map(|perturbation| perturbation.name()).collect(),
            rows: tasks.iter().map(row).collect(),
        }
    };
    report.under_test().map(|policy| map(&policy.name)).collect()
}

fn heat_cell(cell: &CellSummary) -> Option<HeatCell> {
    let (fraction, [low, high]) = (cell.rate.fraction()?, cell.interval?);
    let errors = if cell.errors > 0 { format!(", {} errors", cell.errors) } else { String::new() };
    Some(HeatCell {
        text: format!("{:.0}", 100.0 * fraction),
        interval: format!("{:.0}–{:.0}", 100.0 * low, 100.0 * high),
        title: format!(
            "{} {}: {} of {} = {:.1} % ({:.1} – {:.1}){errors}",
            cell.condition.task.name(),
            cell.condition.perturbation.name(),
            cell.rate.successes,
            cell.rate.n,
            100.0 * fraction,
            100.0 * low,
            100.0 * high,
        ),
        background: background(fraction),
        color: if fraction > 0.55 { "#fff" } else { "#222831" },
    })
}

/// Returns a colour between white and dark blue, which also works in grey.
fn background(fraction: f64) -> String {
    let mix = |low: f64, high: f64| (low + (high - low) * fraction).round() as u8;
    format!("#{:02x}{:02x}{:02x}", mix(247.0, 8.0), mix(250.0, 69.0), mix(253.0, 127.0))
}
