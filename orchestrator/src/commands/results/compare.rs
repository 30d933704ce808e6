//! `hypogeum compare`: which of two policies is better, where, by how much and how surely; or how much a
//! policy loses under perturbations.

use clap::Args;
use serde_json::{Value, json};
use sim::Perturbation;
use sim::perturb::Composition;

use crate::cli::evaluation_args::EvaluationArgs;
use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::output::print_out;
use crate::console::table::{Align, TextTable, interval, p_value, points};
use crate::console::threads::start_threads;
use crate::selection::selectors::PERTURBATION_PARSER;
use crate::statistics::MeanDifference;
use crate::study::analysis::{
    ComparedCell, Comparison, ComparisonKind, ComparisonOptions, Evaluation, TestKind,
};

/// Arguments of `compare`.
#[derive(Args, Debug)]
pub(crate) struct CompareArgs {
    #[command(flatten)]
    pub(crate) evaluation: EvaluationArgs,
    /// First policy, by its name in the results
    #[arg(long, value_name = "NAME", requires = "b", required_unless_present = "policy")]
    pub(crate) a: Option<String>,
    /// Second policy
    #[arg(long, value_name = "NAME", requires = "a")]
    pub(crate) b: Option<String>,
    /// Instead of two policies, one under each of its perturbations and under --against
    #[arg(long, value_name = "NAME", conflicts_with_all = ["a", "b"])]
    pub(crate) policy: Option<String>,
    /// Perturbation to compare with [default: None]
    #[arg(long, value_name = "PERTURBATION", value_parser = PERTURBATION_PARSER, hide_possible_values = true,
        requires = "policy")]
    pub(crate) against: Option<Composition>,
    /// Number of flips to list: matched episodes in which exactly one side succeeds
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub(crate) flips: usize,
    /// Print one JSON object, with all flips, instead of tables
    #[arg(long)]
    pub(crate) json: bool,
}

/// Compares two policies, or a policy with itself under perturbations.
pub(crate) fn compare(args: &CompareArgs) -> Result<ExitStatus, Failure> {
    start_threads()?;
    let evaluation = args.evaluation.read()?;
    let max_flips = if args.json { usize::MAX } else { args.flips };
    let (metric, levels) = (args.evaluation.metric, args.evaluation.levels(&evaluation)?);
    let options = ComparisonOptions { metric, levels, max_flips };
    let comparison = match (&args.policy, &args.a, &args.b) {
        (Some(policy), _, _) => {
            let against = args.against.unwrap_or(Perturbation::None.into());
            Comparison::of_perturbations(&evaluation, policy, against, options)
        }
        (None, Some(a), Some(b)) => Comparison::of_policies(&evaluation, [a, b], options),
        (None, _, _) => unreachable!("clap requires --a and --b, or --policy"),
    };
    let comparison = comparison.or_user()?;
    let text = if args.json {
        format!("{:#}\n", json!(comparison))
    } else {
        differing_options(&evaluation) + &text(&comparison)
    };
    print_out(&text)?;
    Ok(ExitStatus::Success)
}

/// Formats the options in which the files differ, which `--across` allowed.
fn differing_options(evaluation: &Evaluation) -> String {
    let line = |(key, values): (String, Vec<Value>)| {
        let values = evaluation.files.iter().zip(values);
        let values: Vec<String> =
            values.map(|(file, value)| format!("{value} in {}", file.path.display())).collect();
        format!("{key}: {}\n", values.join(", "))
    };
    evaluation.differing_options().into_iter().map(line).collect()
}

/// Formats a comparison for people.
pub(crate) fn text(comparison: &Comparison) -> String {
    let [a, b] = comparison.sides.names();
    let levels = comparison.levels;
    let n_cells = comparison.cells.len();
    let counts = comparison.n_decisions();
    let undecided = counts[3];
    let title = match comparison.sides {
        ComparisonKind::Policies { .. } => format!("A = {a}, B = {b}"),
        ComparisonKind::Perturbations { .. } => format!("A = {a}, B = {b}, on the same episodes"),
    };
    let notes = match comparison.tests {
        TestKind::FixedSample if undecided > 0 => {
            "further episodes: as many as decide with a probability of 80 % if the rates are as observed. Looking again after \
             adding them makes false verdicts more frequent; `run --until-decided` may look at any time\n"
        }
        TestKind::FixedSample => "",
        TestKind::Sequential => {
            "cells ended when they were decided: tests and intervals hold at every moment; a difference that ended its cell \
             is too large on average. No means over such cells\n"
        }
    };
    format!(
        "{title}; difference = {} of A − B\n\n{}\n{}\n{n_cells} cells: {}\n\
         (level {}; within each table, both kinds of verdicts are adjusted by Holm's method; definitions: \
         docs/conclusions.md)\n{notes}{}",
        comparison.metric.name(),
        cell_table(comparison),
        group_table(comparison),
        comparison.sides.counts(counts, levels.margin),
        levels.alpha,
        flip_lines(comparison),
    )
}

fn cell_table(comparison: &Comparison) -> String {
    use Align::{Left, Right};
    let levels = comparison.levels;
    let confidence = format!("{:.0} % interval", 100.0 * (1.0 - levels.alpha));
    let mut table = TextTable::new(&[
        ("task", Left),
        ("perturbation", Left),
        ("n", Right),
        ("A", Right),
        ("B", Right),
        ("only A", Right),
        ("only B", Right),
        ("difference", Right),
        (&confidence, Right),
        ("p", Right),
        ("adjusted", Right),
        ("verdict", Left),
    ]);
    for cell in &comparison.cells {
        table.row(vec![
            cell.condition.task.name().to_owned(),
            cell.condition.perturbation.name(),
            cell.n.to_string(),
            cell.successes[0].to_string(),
            cell.successes[1].to_string(),
            cell.pairs.only_a.to_string(),
            cell.pairs.only_b.to_string(),
            points(cell.difference),
            interval(cell.interval),
            p_value(cell.p),
            p_value(cell.adjusted_p),
            comparison.sides.verdict(&cell.verdict, cell.difference, levels.margin),
        ]);
    }
    let left_out = |count: fn(&ComparedCell) -> u32, what: &str| {
        let n: u32 = comparison.cells.iter().map(count).sum();
        if n == 0 { String::new() } else { format!("left out: {n} {what}\n") }
    };
    table.to_string()
        + &left_out(|cell| cell.n_errors, "episodes with an error on either side")
        + &left_out(|cell| cell.n_unmatched, "episodes that only one side has")
}

fn group_table(comparison: &Comparison) -> String {
    use Align::{Left, Right};
    if comparison.groups.is_empty() {
        return String::new();
    }
    let confidence = format!("{:.0} % interval", 100.0 * (1.0 - comparison.levels.alpha));
    let mut table = TextTable::new(&[
        ("mean over", Left),
        ("cells", Right),
        ("pairs", Right),
        ("difference", Right),
        (&confidence, Right),
        ("p", Right),
        ("adjusted", Right),
        ("verdict", Left),
    ]);
    for group in &comparison.groups {
        let MeanDifference { mean, interval: bounds, p, n_cells, .. } = group.estimate;
        table.row(vec![
            group.group.clone(),
            n_cells.to_string(),
            group.n.to_string(),
            points(mean),
            interval(bounds),
            p_value(p),
            p_value(group.adjusted_p),
            comparison.sides.verdict(&group.verdict, mean, comparison.levels.margin),
        ]);
    }
    table.to_string()
}

fn flip_lines(comparison: &Comparison) -> String {
    let (n_flips, n_listed) = (comparison.n_flips, comparison.flips.len());
    if n_listed == 0 {
        return format!("\n{n_flips} flips\n");
    }
    let mut text = format!("\n{n_flips} flips, {n_listed} of them here (--json lists all):\n");
    for flip in &comparison.flips {
        let [winner, loser] = if flip.a_succeeds { ["A", "B"] } else { ["B", "A"] };
        let unmet = flip.failed_predicate.as_deref().unwrap_or("nothing at the end");
        text += &format!(
            "{} {} episode {}: {winner} succeeds, {loser} fails ({unmet}); {}\n",
            flip.condition.task.name(),
            flip.condition.perturbation.name(),
            flip.episode,
            flip.replay_command(),
        );
    }
    text
}
