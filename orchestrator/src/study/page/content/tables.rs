//! The tables of comparisons.

use serde::Serialize;

use crate::study::analysis::{Comparison, ComparisonKind, Flip};
use crate::study::page::content::ReportContent;
use crate::study::page::content::headlines::predicate_words;

/// A table of a comparison, ready for the template.
#[derive(Debug, Serialize)]
pub(crate) struct ComparisonTable {
    title: String,
    counts: String,
    rows: Vec<ComparisonRow>,
    groups: Vec<ComparisonRow>,
    flips: Vec<FlipRow>,
    n_flips: usize,
}

#[derive(Debug, Serialize)]
struct ComparisonRow {
    label: String,
    perturbation: String,
    n: u32,
    successes: [u32; 2],
    only: [u32; 2],
    difference: f64,
    interval: [f64; 2],
    p: f64,
    verdict: String,
}

#[derive(Debug, Serialize)]
struct FlipRow {
    cell: String,
    episode: u32,
    winner: String,
    failed: String,
    command: String,
}

/// Flips listed on the page.
const MAX_LISTED_FLIPS: usize = 50;

/// Returns the comparisons as tables.
pub(crate) fn comparison_tables(report: &ReportContent) -> Vec<ComparisonTable> {
    report.comparisons.iter().chain(&report.perturbations).map(comparison_table).collect()
}

fn comparison_table(comparison: &Comparison) -> ComparisonTable {
    let names = comparison.sides.short_names();
    let (sides, margin) = (&comparison.sides, comparison.levels.margin);
    let percent = |pair: [f64; 2]| pair.map(|bound| 100.0 * bound);
    let rows = comparison.cells.iter().map(|cell| ComparisonRow {
        label: cell.condition.task.name().to_owned(),
        perturbation: cell.condition.perturbation.name(),
        n: cell.n,
        successes: cell.successes,
        only: [cell.pairs.only_a, cell.pairs.only_b],
        difference: 100.0 * cell.difference,
        interval: percent(cell.interval),
        p: cell.adjusted_p,
        verdict: sides.verdict(&cell.verdict, cell.difference, margin),
    });
    let groups = comparison.groups.iter().map(|group| ComparisonRow {
        label: format!("mean: {}", group.group),
        perturbation: format!("{} cells", group.estimate.n_cells),
        n: group.n,
        successes: [0; 2],
        only: [0; 2],
        difference: 100.0 * group.estimate.mean,
        interval: percent(group.estimate.interval),
        p: group.adjusted_p,
        verdict: sides.verdict(&group.verdict, group.estimate.mean, margin),
    });
    let flip = |flip: &Flip| FlipRow {
        cell: format!("{} · {}", flip.condition.task.name(), flip.condition.perturbation.name()),
        episode: flip.episode,
        winner: names[usize::from(!flip.a_succeeds)].to_owned(),
        failed: flip
            .failed_predicate
            .as_deref()
            .map_or_else(String::new, |name| predicate_words(name).to_owned()),
        command: flip.replay_command(),
    };
    ComparisonTable {
        title: match &comparison.sides {
            ComparisonKind::Policies { a, b } => format!("{a} (A) against {b} (B)"),
            ComparisonKind::Perturbations { policy, against } => {
                format!("{policy} under perturbations (A) against {against} (B)")
            }
        },
        counts: sides.counts(comparison.n_decisions(), margin),
        rows: rows.collect(),
        groups: groups.collect(),
        n_flips: comparison.n_flips,
        flips: comparison.flips.iter().take(MAX_LISTED_FLIPS).map(flip).collect(),
    }
}
