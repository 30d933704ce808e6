//! Honest warnings: reasons to read the numbers with care.

use sim::Perturbation;

use crate::store::results::gaps;
use crate::study::analysis::{CellSummary, Evaluation};
use crate::study::page::content::{PolicyRole, ReportContent};

/// Episodes below which a headline cell is called small.
const SMALL_N: u32 = 50;

/// Returns the warnings of a report, most important first.
pub(crate) fn warnings(report: &ReportContent, evaluation: &Evaluation) -> Vec<String> {
    let mut warnings = Vec::new();
    let mut warn = |is_due: bool, text: String| {
        if is_due {
            warnings.push(text);
        }
    };
    for file in evaluation.files.iter().filter(|file| file.in_use) {
        warn(
            true,
            format!("{}: a run was still writing to it; later episodes are missing", file.path.display()),
        );
    }
    for file in evaluation.files.iter().filter(|file| !file.in_use) {
        let n_missing: u32 = gaps(file).ok().flatten().unwrap_or_default().iter().map(|gap| gap.n).sum();
        warn(
            n_missing > 0,
            format!(
                "{}: {n_missing} planned episodes are missing. Resume the run, or see `hypogeum verify`.",
                file.path.display()
            ),
        );
    }
    let errors: u32 = report.cells.iter().map(|cell| cell.errors).sum();
    warn(
        errors > 0,
        format!("{errors} episodes could not be run. They count neither as successes nor as failures."),
    );
    let has = |role| report.policies.iter().any(|policy| policy.role == role);
    warn(
        !has(PolicyRole::Floor),
        "There is no floor: evaluate the policy `idle` on the same episodes.".to_owned(),
    );
    warn(
        !has(PolicyRole::Ceiling),
        "There is no ceiling: evaluate `expert` on the same episodes.".to_owned(),
    );
    let under_test = |cell: &&CellSummary| {
        report.policies.iter().any(|policy| policy.role == PolicyRole::Policy && policy.name == cell.policy)
    };
    let is_headline = |cell: &&CellSummary| cell.condition.perturbation == Perturbation::None.into();
    let small = report.cells.iter().filter(under_test).filter(is_headline);
    let small = small.filter(|cell| cell.rate.n < SMALL_N).count();
    warn(
        small > 0,
        format!("{small} unperturbed cells have fewer than {SMALL_N} episodes; their intervals are wide."),
    );
    for (policy, tasks) in near_floor(report) {
        warn(
            true,
            format!(
                "{policy} is below 10 % on {}: changes under perturbation mean nothing there, and the averages leave these \
                 tasks out, as the paper does.",
                tasks.join(", ")
            ),
        );
    }
    let stopped = evaluation.files.iter().any(|file| file.stopping.is_some());
    warn(
        stopped,
        "Cells ended as soon as a comparison was decided (--until-decided). Their tests and intervals hold at every moment, \
         differences are too large on average, and nothing is averaged over such cells."
            .to_owned(),
    );
    warnings
}

/// Returns the tasks on which a policy under test succeeds in less than 10 % of the unperturbed episodes.
fn near_floor(report: &ReportContent) -> Vec<(String, Vec<&'static str>)> {
    let policies = report.policies.iter().filter(|policy| policy.role == PolicyRole::Policy);
    let weak = policies.map(|policy| {
        let unperturbed = report
            .cells_of(&policy.name)
            .filter(|cell| cell.condition.perturbation == Perturbation::None.into());
        let weak = unperturbed.filter(|cell| cell.rate.fraction().is_some_and(|rate| rate < 0.1));
        (policy.name.clone(), weak.map(|cell| cell.condition.task.name()).collect::<Vec<_>>())
    });
    weak.filter(|(_, tasks)| !tasks.is_empty()).collect()
}
