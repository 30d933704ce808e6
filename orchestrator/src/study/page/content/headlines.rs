//! The first screen of the page: one sentence per pair of policies, the paper's averages, and the
//! circumstances.

use ipc_types::Morphology;
use serde::Serialize;
use serde_json::Value;
use sim::Perturbation;
use sim::perturb::Modality;

use crate::console::table::p_value;
use crate::statistics::{Decision, Levels};
use crate::study::analysis::{
    ComparedCell, ComparedGroup, Comparison, ComparisonKind, MODALITIES, TestKind, modality_name,
    morphology_name,
};
use crate::study::page::content::{PolicyRole, ReportContent};

/// The averages of one policy with one robot, in percent and percentage points.
#[derive(Debug, Serialize)]
pub(crate) struct AverageRow {
    policy: String,
    robot: &'static str,
    unperturbed: f64,
    /// Vision, language, action: change, mean relative change, and how many perturbations of how many.
    modalities: Vec<AverageCell>,
    all: Option<f64>,
    /// Number of tasks that count for the changes.
    n_tasks: usize,
}

#[derive(Debug, Serialize)]
struct AverageCell {
    change: Option<f64>,
    relative: Option<f64>,
    n: String,
}

/// Returns one sentence per compared pair of policies.
pub(crate) fn sentences(report: &ReportContent) -> Vec<String> {
    report.comparisons.iter().filter_map(sentence).collect()
}

fn sentence(comparison: &Comparison) -> Option<String> {
    let ComparisonKind::Policies { a, b } = &comparison.sides else { return None };
    let [a_better, b_better, equivalent, undecided] = comparison.n_decisions();
    let n_cells = comparison.cells.len();
    if comparison.tests == TestKind::Sequential {
        return Some(format!(
            "{a} against {b}, each cell until decided: {a} is better in {a_better} of {n_cells} cells and {b} in {b_better}; \
             {equivalent} show no difference larger than {:.1} points, and {undecided} are undecided.",
            100.0 * comparison.levels.margin
        ));
    }
    let overall = comparison.groups.first()?;
    let verdict = overall_verdict([a, b], overall, comparison.levels);
    Some(format!(
        "{verdict} ({} over {n_cells} cells with {} pairs; adjusted p {}).{}",
        numbers(overall, comparison.levels),
        overall.n,
        p_value(overall.adjusted_p),
        most([a, b], comparison)
    ))
}

fn overall_verdict([a, b]: [&String; 2], overall: &ComparedGroup, levels: Levels) -> String {
    let points = format!("{:.1} points", 100.0 * overall.estimate.mean.abs());
    match overall.verdict.decision {
        Decision::ABetter => format!("{a} is better than {b} by {points}"),
        Decision::BBetter => format!("{b} is better than {a} by {points}"),
        Decision::Equivalent => {
            format!("{a} and {b} differ by less than {:.1} points", 100.0 * levels.margin)
        }
        Decision::Undecided => {
            let more = overall.verdict.more_episodes.map_or_else(String::new, |more| {
                format!(": about {more} more episodes per cell would decide with a probability of 80 %")
            });
            format!("Whether {a} or {b} is better is undecided{more}")
        }
    }
}

fn numbers(overall: &ComparedGroup, levels: Levels) -> String {
    let [low, high] = overall.estimate.interval.map(|bound| 100.0 * bound);
    let confidence = 100.0 * (1.0 - levels.alpha);
    format!("{:+.1}, {confidence:.0} % interval {low:+.1} … {high:+.1} points", 100.0 * overall.estimate.mean)
}

/// Says in which cell the decided difference is largest.
fn most([a, b]: [&String; 2], comparison: &Comparison) -> String {
    let is_decided =
        |cell: &&ComparedCell| matches!(cell.verdict.decision, Decision::ABetter | Decision::BBetter);
    let decided: Vec<&ComparedCell> = comparison.cells.iter().filter(is_decided).collect();
    let largest = decided.iter().max_by(|x, y| x.difference.abs().total_cmp(&y.difference.abs()));
    let Some(largest) = largest else {
        return " No single cell shows a better policy.".to_owned();
    };
    format!(
        " {} of {} cells show a better policy; the difference is largest on {} under {}, where {} is {:.0} points better.",
        decided.len(),
        comparison.cells.len(),
        largest.condition.task.name(),
        largest.condition.perturbation.name(),
        if largest.difference > 0.0 { a } else { b },
        100.0 * largest.difference.abs()
    )
}

/// Returns the sentence on floor and ceiling; `None` without either.
pub(crate) fn bounds(report: &ReportContent) -> Option<String> {
    let part = |(role, what): (PolicyRole, &str)| {
        let policy = report.policies.iter().find(|policy| policy.role == role)?;
        let rate = policy.unperturbed.fraction()?;
        let (name, n) = (&policy.name, policy.unperturbed.n);
        Some(format!("the {what} ({name}) succeeds in {:.1} % of {n} unperturbed episodes", 100.0 * rate))
    };
    let parts = [(PolicyRole::Floor, "floor"), (PolicyRole::Ceiling, "ceiling")].into_iter().filter_map(part);
    let parts: Vec<String> = parts.collect();
    (!parts.is_empty()).then(|| format!("For scale: {}.", parts.join(", ")))
}

/// Returns the paper's averages of the policies under test.
pub(crate) fn averages(report: &ReportContent) -> Vec<AverageRow> {
    let mut rows = Vec::new();
    for policy in report.under_test() {
        for morphology in Morphology::ALL {
            let own = || {
                let effects = report.effects.iter();
                effects.filter(|effect| effect.policy == policy.name && effect.morphology == morphology)
            };
            let of =
                |perturbation: Perturbation| own().find(|effect| effect.perturbation == perturbation.into());
            let percent = |value: f64| 100.0 * value;
            let Some(none) = of(Perturbation::None) else { continue };
            let modality = |modality: Modality| {
                let found = report.modality_effect(&policy.name, morphology, modality);
                AverageCell {
                    change: found.and_then(|effect| effect.change).map(percent),
                    relative: found.and_then(|effect| effect.relative_change).map(percent),
                    n: found
                        .map_or_else(String::new, |effect| format!("{} of {}", effect.n_run, effect.n_all)),
                }
            };
            rows.push(AverageRow {
                policy: policy.name.clone(),
                robot: morphology_name(morphology),
                unperturbed: percent(none.success),
                modalities: MODALITIES.map(modality).into_iter().collect(),
                all: of(Perturbation::All).and_then(|effect| effect.change).map(percent),
                n_tasks: none.n_tasks,
            });
        }
    }
    rows
}

/// Returns the heads of the columns of modalities.
pub(crate) fn modality_names() -> [&'static str; 3] {
    MODALITIES.map(modality_name)
}

/// Returns the sentence on date, machine and speed of the runs.
pub(crate) fn circumstances(report: &ReportContent) -> String {
    let text = |key: &str| report.environment.get(key).and_then(Value::as_str);
    let n_episodes: usize = report.files.iter().map(|file| file.n_episodes).sum();
    let mut parts = vec![format!("{n_episodes} episodes")];
    if let Some(wall_s) =
        report.environment.get("wall_s").and_then(Value::as_f64).filter(|_| report.files.len() == 1)
    {
        let steps: u64 = report.cells.iter().map(|cell| cell.steps).sum();
        parts.push(format!("{wall_s:.0} s, {:.0} control steps per second", steps as f64 / wall_s));
    }
    if let Some(machine) = report.environment.get("machine") {
        let cpu = machine.get("cpu").and_then(Value::as_str).unwrap_or("unknown CPU");
        let n_cores = machine.get("n_cores").and_then(Value::as_u64).unwrap_or(0);
        parts.push(format!("{n_cores} cores of {cpu}"));
    }
    parts.extend(text("date").map(|date| date.replace('T', " ").replace('Z', " UTC")));
    parts.extend(text("commit").map(|commit| format!("commit {commit}")));
    parts.join(" · ")
}

/// Returns what a failed predicate means, in words. Other texts stay as they are.
pub(crate) fn predicate_words(name: &str) -> &str {
    match name {
        "above" => "the body is not high enough",
        "moved" => "the body has not moved far enough",
        "inside" => "the body is not in its place",
        "offset" => "the body is not where it belongs on the other one",
        "opened" => "the joint is not open far enough",
        "aligned" => "the body is not aligned",
        "euler" => "the body does not stand upright",
        "at" => "the body is not at its goal",
        "on" => "the body is not on the other one",
        "still" => "the body still moves",
        "robot_still" => "the robot still moves",
        "nearer" => "the other arm is nearer, or none grasps the body",
        "held" => "no arm holds the body",
        "released" => "an arm still holds the body",
        other => other,
    }
}
