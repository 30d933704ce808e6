//! `hypogeum plan`: how many episodes a comparison needs, and how long they take.

use std::path::PathBuf;

use anyhow::anyhow;
use clap::Args;
use serde::Serialize;
use serde_json::json;

use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::output::print_out;
use crate::console::table::{Align, TextTable};
use crate::plan::sweep::{DEFAULT_LEVELS, parse_level, parse_margin};
use crate::statistics::{Levels, POWER, PairRates};
use crate::study::analysis::{Comparison, ComparisonOptions, Evaluation, Metric, read_files};

/// Differences that are planned for unless the user names others.
const DEFAULT_DIFFERENCES: [f64; 3] = [0.05, 0.1, 0.2];

/// Arguments of `plan`.
#[derive(Args, Debug)]
pub(crate) struct PlanArgs {
    /// Results file with a few episodes of both policies, from which discordance and speed are taken
    #[arg(value_name = "RESULTS.db", requires = "a", required_unless_present = "discordance")]
    pub(crate) file: Option<PathBuf>,
    /// First policy, by its name in the results
    #[arg(long, value_name = "NAME", requires_all = ["b", "file"])]
    pub(crate) a: Option<String>,
    /// Second policy
    #[arg(long, value_name = "NAME", requires = "a")]
    pub(crate) b: Option<String>,
    /// Without a results file: share of matched episodes in which exactly one policy succeeds
    #[arg(long, value_name = "P", value_parser = parse_margin, conflicts_with = "file")]
    pub(crate) discordance: Option<f64>,
    /// Difference of success rates to find, comma-separated [default: 0.05,0.1,0.2, as far as possible]
    #[arg(long, value_name = "D", value_delimiter = ',', value_parser = parse_margin)]
    pub(crate) difference: Option<Vec<f64>>,
    /// Number of cells that are judged together [default: those of the results, or 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub(crate) cells: Option<u32>,
    /// Smallest difference of success rates that matters
    #[arg(long, value_name = "M", value_parser = parse_margin, default_value_t = DEFAULT_LEVELS.margin)]
    pub(crate) margin: f64,
    /// Probability of a false verdict of either kind in a table
    #[arg(long, value_name = "P", value_parser = parse_level, default_value_t = DEFAULT_LEVELS.alpha)]
    pub(crate) alpha: f64,
    /// Print one JSON object instead of a table
    #[arg(long)]
    pub(crate) json: bool,
}

/// The rates and the speed from which numbers are planned.
struct Observed {
    source: String,
    discordance: f64,
    n_cells: usize,
    /// Variance of the mean over all cells relative to that of as many independent pairs.
    design_effect: f64,
    /// Episodes per second of the runs that made the file.
    episodes_per_s: Option<f64>,
}

/// The plan for one true difference.
#[derive(Serialize)]
struct PlannedRow {
    /// True difference of the success rates.
    difference: f64,
    /// Episodes per cell and policy, and seconds for all cells and both policies: for one cell, and for the
    /// mean over all cells.
    one_cell: Option<PlannedEpisodes>,
    mean: Option<PlannedEpisodes>,
}

#[derive(Serialize)]
struct PlannedEpisodes {
    per_cell: u64,
    seconds: Option<f64>,
}

/// Prints how many episodes are needed.
pub(crate) fn plan(args: &PlanArgs) -> Result<ExitStatus, Failure> {
    let levels = Levels { alpha: args.alpha, margin: args.margin };
    let observed = match (&args.file, args.discordance) {
        (Some(_), _) => observe(args, levels)?,
        (None, Some(discordance)) => Observed {
            source: "as given".to_owned(),
            discordance,
            n_cells: args.cells.unwrap_or(1) as usize,
            design_effect: 1.0,
            episodes_per_s: None,
        },
        (None, None) => unreachable!("clap requires a file or --discordance"),
    };
    let is_possible = |difference: &f64| *difference <= observed.discordance;
    let differences = args
        .difference
        .clone()
        .unwrap_or_else(|| DEFAULT_DIFFERENCES.into_iter().filter(is_possible).collect());
    if let Some(difference) = differences.iter().find(|difference| !is_possible(difference)) {
        return Err(anyhow!(
            "--difference is {difference}, but only {:.4} of the pairs have exactly one success ({}): the rates cannot differ by \
             more than that",
            observed.discordance,
            observed.source
        ))
        .or_user();
    }
    let differences = std::iter::once(0.0).chain(differences);
    let rows: Vec<PlannedRow> = differences.map(|difference| row(&observed, difference, levels)).collect();
    let text = if args.json {
        let Observed { source, discordance, n_cells, design_effect, episodes_per_s } = observed;
        let from = json!({
            "source": source, "discordance": discordance, "cells": n_cells, "design_effect": design_effect,
            "episodes_per_s": episodes_per_s,
        });
        format!("{:#}\n", json!({ "from": from, "levels": levels, "power": POWER, "rows": rows }))
    } else {
        text(&observed, &rows, levels)
    };
    print_out(&text)?;
    Ok(ExitStatus::Success)
}

/// Takes discordance and speed from the results.
fn observe(args: &PlanArgs, levels: Levels) -> Result<Observed, Failure> {
    let (Some(path), Some(a), Some(b)) = (&args.file, &args.a, &args.b) else {
        unreachable!("clap requires --a and --b with a file")
    };
    let evaluation = Evaluation::new(read_files(std::slice::from_ref(path)).or_user()?, &[]).or_user()?;
    let options = ComparisonOptions { metric: Metric::default(), levels, max_flips: 0 };
    let comparison = Comparison::of_policies(&evaluation, [a, b], options).or_user()?;
    let rates = comparison.cells.iter().filter_map(|cell| PairRates::of_cell(&cell.pairs));
    let n_cells = comparison.cells.len();
    let n_pairs: u32 = comparison.cells.iter().map(|cell| cell.n).sum();
    let overall = comparison.groups.first().map(|group| &group.estimate);
    Ok(Observed {
        source: format!("observed in {n_pairs} pairs of {n_cells} cells of {}", path.display()),
        discordance: rates.map(|rates| rates.discordance).sum::<f64>() / n_cells as f64,
        n_cells: args.cells.map_or(n_cells, |n| n as usize),
        design_effect: overall.map_or(1.0, |mean| (f64::from(n_pairs) / mean.n_effective).max(1.0)),
        episodes_per_s: evaluation.files[0].episodes_per_s(),
    })
}

fn row(observed: &Observed, difference: f64, levels: Levels) -> PlannedRow {
    let Observed { discordance, n_cells, design_effect, episodes_per_s, .. } = *observed;
    let rates = PairRates { difference, discordance };
    let planned = |pairs: f64| {
        let per_cell = pairs.is_finite().then(|| pairs.ceil().max(1.0) as u64)?;
        let n_episodes = 2.0 * per_cell as f64 * n_cells as f64;
        Some(PlannedEpisodes { per_cell, seconds: episodes_per_s.map(|speed| n_episodes / speed) })
    };
    PlannedRow {
        difference,
        one_cell: planned(rates.pairs_needed(levels, [n_cells; 2])),
        mean: planned(rates.pairs_needed(levels, [1; 2]) * design_effect / n_cells as f64),
    }
}

fn text(observed: &Observed, rows: &[PlannedRow], levels: Levels) -> String {
    use Align::Right;
    let n_cells = observed.n_cells;
    let mut table = TextTable::new(&[
        ("true difference", Right),
        (&format!("each of {n_cells} cells"), Right),
        ("time", Right),
        (&format!("mean over {n_cells} cells"), Right),
        ("time", Right),
    ]);
    let cells = |planned: &Option<PlannedEpisodes>| match planned {
        Some(PlannedEpisodes { per_cell, seconds }) => {
            [per_cell.to_string(), seconds.map_or_else(|| "–".to_owned(), duration)]
        }
        None => ["never".to_owned(), "–".to_owned()],
    };
    for row in rows {
        let ([one, one_time], [mean, mean_time]) = (cells(&row.one_cell), cells(&row.mean));
        table.row(vec![format!("{:.1} pp", 100.0 * row.difference), one, one_time, mean, mean_time]);
    }
    let speed = match observed.episodes_per_s {
        Some(speed) => {
            format!("time: both policies in all cells, at the {speed:.2} episodes/s of that file's runs")
        }
        None => {
            "time: unknown; run a few episodes of both policies, then `hypogeum plan RESULTS.db --a A --b B`"
                .to_owned()
        }
    };
    format!(
        "episodes per cell and policy for a decision with a probability of {:.0} %: which policy is better, or that the \
         difference is below {:.1} pp\n\n{table}\n\
         discordance {:.3} ({}); level {} for all verdicts of a table together\n{speed}\n\
         `run --until-decided A,B --episodes N` stops each cell as soon as it is decided\n",
        100.0 * POWER,
        100.0 * levels.margin,
        observed.discordance,
        observed.source,
        levels.alpha,
    )
}

/// Formats seconds for people.
fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 90.0 => format!("{s:.0} s"),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s if s < 172_800.0 => format!("{:.1} h", s / 3600.0),
        s => format!("{:.1} days", s / 86_400.0),
    }
}
