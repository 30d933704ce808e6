//! A comparison of two sides on matched episodes: every cell, groups of cells, and verdicts.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use sim::TaskId;
use sim::perturb::Composition;
use thiserror::Error;

use super::evaluation::{Evaluation, EvaluationError};
use super::flips::{Flip, flips};
use super::groups::Group;
use super::matching::{MatchedCell, Metric, Side, match_cells};
use crate::plan::Condition;
use crate::results::STOPPING;
use crate::statistics::{
    BootstrapCell, Decision, Estimate, Levels, PairedSequence, Pairs, Verdict, cluster_bootstrap, holm,
    mcnemar_mid_p, sequential_decision, tango_interval,
};

/// The two sides of a comparison.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum ComparisonKind {
    /// Two policies under the same conditions.
    Policies {
        /// Name of A.
        a: String,
        /// Name of B.
        b: String,
    },
    /// One policy under each of its perturbations (A) and under one of them (B), on twins.
    Perturbations {
        /// Name of the policy.
        policy: String,
        /// Name of the perturbation of side B.
        against: String,
    },
}

/// The kind of tests and intervals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum TestKind {
    /// For a number of episodes that was fixed beforehand: McNemar's test and Tango's interval.
    FixedSample,
    /// Valid at every moment, because cells may have ended when they were decided: e-values and confidence
    /// sequences. There are no groups, whose cells would have different numbers of episodes.
    Sequential,
}

/// The choices of a comparison.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ComparisonOptions {
    pub(crate) metric: Metric,
    pub(crate) levels: Levels,
    /// Maximum number of flips to list.
    pub(crate) max_flips: usize,
}

/// A comparison.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Comparison {
    pub(crate) sides: ComparisonKind,
    pub(crate) tests: TestKind,
    pub(crate) metric: Metric,
    pub(crate) levels: Levels,
    pub(crate) cells: Vec<ComparedCell>,
    pub(crate) groups: Vec<ComparedGroup>,
    /// Number of episodes in which exactly one side succeeds.
    pub(crate) n_flips: usize,
    /// The first of these episodes.
    pub(crate) flips: Vec<Flip>,
}

/// One cell of a comparison.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct ComparedCell {
    #[serde(flatten)]
    pub(crate) condition: Condition,
    /// Number of pairs.
    pub(crate) n: u32,
    /// Successes of A and B.
    pub(crate) successes: [u32; 2],
    pub(crate) pairs: Pairs,
    /// Success rate of A minus that of B.
    pub(crate) difference: f64,
    /// Interval of the difference at 1 − alpha.
    pub(crate) interval: [f64; 2],
    /// p-value of equal success rates.
    pub(crate) p: f64,
    /// The same, adjusted by Holm's method for all cells of the comparison.
    pub(crate) adjusted_p: f64,
    pub(crate) verdict: Verdict,
    /// Matched episodes with an error on either side, which are left out.
    pub(crate) n_errors: u32,
    /// Episodes that only one side has, which are left out.
    pub(crate) n_unmatched: u32,
}

/// The mean over a group of cells, each with the same weight.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct ComparedGroup {
    pub(crate) group: String,
    /// Number of pairs in all cells.
    pub(crate) n: u32,
    #[serde(flatten)]
    pub(crate) estimate: Estimate,
    pub(crate) verdict: Verdict,
}

/// Reasons why two sides cannot be compared.
#[derive(Debug, Error)]
pub(crate) enum ComparisonError {
    #[error(transparent)]
    Evaluation(#[from] EvaluationError),
    #[error(
        "`{0}` cannot be compared with itself; name two policies, or one with --policy NAME --against None"
    )]
    SamePolicy(String),
    #[error("{a} and {b} have no episode in common: no task and perturbation with the same episode indices")]
    NothingInCommon { a: String, b: String },
}

impl Comparison {
    /// Compares A and B under all conditions that both have.
    ///
    /// # Errors
    /// If there is no such policy, or the two have no episode in common.
    pub(crate) fn of_policies(
        evaluation: &Evaluation,
        [a, b]: [&str; 2],
        options: ComparisonOptions,
    ) -> Result<Self, ComparisonError> {
        let sides = [a, b].map(|name| evaluation.policy(name));
        let [side_a, side_b] = sides;
        let sides = [side_a?, side_b?].map(|policy| Side { policy, perturbation: None });
        if a == b {
            return Err(ComparisonError::SamePolicy(a.to_owned()));
        }
        let cells = match_cells(evaluation, sides, options.metric);
        let groups = Group::OF_POLICIES.to_vec();
        let kind = ComparisonKind::Policies { a: a.to_owned(), b: b.to_owned() };
        Self::new(evaluation, kind, &cells, &groups, options)
    }

    /// Compares a policy under each perturbation with its own twins under `against`.
    ///
    /// # Errors
    /// If there is no such policy, or it has no twins under `against`.
    pub(crate) fn of_perturbations(
        evaluation: &Evaluation,
        policy: &str,
        against: Composition,
        options: ComparisonOptions,
    ) -> Result<Self, ComparisonError> {
        let own = evaluation.policy(policy)?;
        let sides = [None, Some(against)].map(|perturbation| Side { policy: own, perturbation });
        let cells = match_cells(evaluation, sides, options.metric);
        let conditions: Vec<Condition> = cells.iter().map(|cell| cell.condition).collect();
        let groups = Group::of_perturbations(&conditions);
        let kind = ComparisonKind::Perturbations { policy: policy.to_owned(), against: against.name() };
        Self::new(evaluation, kind, &cells, &groups, options)
    }

    fn new(
        evaluation: &Evaluation,
        sides: ComparisonKind,
        matched: &[MatchedCell],
        groups: &[Group],
        options: ComparisonOptions,
    ) -> Result<Self, ComparisonError> {
        let ComparisonOptions { metric, levels, max_flips } = options;
        let matched: Vec<&MatchedCell> = matched.iter().filter(|cell| !cell.episodes.is_empty()).collect();
        if matched.is_empty() {
            let [a, b] = sides.names();
            return Err(ComparisonError::NothingInCommon { a, b });
        }
        let is_sequential = evaluation.files.iter().any(|file| file.manifest.contains_key(STOPPING));
        let tests = if is_sequential { TestKind::Sequential } else { TestKind::FixedSample };
        let (cells, groups) = match tests {
            TestKind::FixedSample => {
                (fixed_sample_cells(&matched, levels), compared_groups(&matched, groups, levels))
            }
            TestKind::Sequential => (sequential_cells(&matched, levels), Vec::new()),
        };
        Ok(Self {
            n_flips: matched.iter().map(|cell| cell.pairs().discordant() as usize).sum(),
            flips: flips(evaluation, &matched, max_flips),
            groups,
            sides,
            tests,
            metric,
            levels,
            cells,
        })
    }

    /// Returns the numbers of cells by decision: A better, B better, equivalent, undecided.
    pub(crate) fn n_decisions(&self) -> [usize; 4] {
        let decisions = [Decision::ABetter, Decision::BBetter, Decision::Equivalent, Decision::Undecided];
        decisions.map(|kind| self.cells.iter().filter(|cell| cell.verdict.decision == kind).count())
    }
}

impl ComparisonKind {
    /// Returns the names of both sides for people.
    pub(crate) fn names(&self) -> [String; 2] {
        match self {
            Self::Policies { a, b } => [a.clone(), b.clone()],
            Self::Perturbations { policy, against } => {
                [format!("{policy} under the perturbation"), format!("{policy} under {against}")]
            }
        }
    }

    /// Returns the names of both sides in verdicts.
    pub(crate) fn short_names(&self) -> [&str; 2] {
        match self {
            Self::Policies { a, b } => [a, b],
            Self::Perturbations { against, .. } => ["perturbed", against],
        }
    }
}

/// Compares cells whose number of episodes was fixed beforehand.
fn fixed_sample_cells(matched: &[&MatchedCell], levels: Levels) -> Vec<ComparedCell> {
    let p_values: Vec<f64> = matched.iter().map(|cell| mcnemar_mid_p(&cell.pairs())).collect();
    let adjusted = holm(&p_values);
    let cells = matched.iter().zip(p_values.into_iter().zip(adjusted));
    cells
        .map(|(cell, p)| {
            let pairs = cell.pairs();
            let interval = tango_interval(&pairs, levels.z()).unwrap_or([-1.0, 1.0]);
            compared(cell, pairs, p, interval, Verdict::new(&pairs, p.1, levels))
        })
        .collect()
}

/// Compares cells that may have ended when they were decided.
fn sequential_cells(matched: &[&MatchedCell], levels: Levels) -> Vec<ComparedCell> {
    let sequences: Vec<PairedSequence> = matched.iter().map(|cell| cell.sequence(levels.alpha)).collect();
    let p_values: Vec<f64> = sequences.iter().map(PairedSequence::p_value).collect();
    let adjusted = holm(&p_values);
    let cells = matched.iter().zip(&sequences).zip(p_values.into_iter().zip(adjusted));
    cells
        .map(|((cell, sequence), p)| {
            let decision = sequential_decision(sequence, p.1, levels).unwrap_or(Decision::Undecided);
            let verdict = Verdict { decision, more_episodes: None };
            compared(cell, *sequence.pairs(), p, sequence.interval(), verdict)
        })
        .collect()
}

fn compared(
    cell: &MatchedCell,
    pairs: Pairs,
    (p, adjusted_p): (f64, f64),
    interval: [f64; 2],
    verdict: Verdict,
) -> ComparedCell {
    ComparedCell {
        condition: cell.condition,
        n: pairs.n(),
        successes: pairs.successes(),
        difference: pairs.difference().unwrap_or(0.0),
        interval,
        p,
        adjusted_p,
        verdict,
        pairs,
        n_errors: cell.n_errors,
        n_unmatched: cell.n_unmatched,
    }
}

/// Averages the cells of each group that has any.
fn compared_groups(cells: &[&MatchedCell], groups: &[Group], levels: Levels) -> Vec<ComparedGroup> {
    let members = |group: &Group| {
        let cells = cells.iter().enumerate().filter(|(_, cell)| group.contains(&cell.condition));
        cells.map(|(idx, _)| idx).collect::<Vec<_>>()
    };
    let groups: Vec<(&Group, Vec<usize>)> = groups.iter().map(|group| (group, members(group))).collect();
    let indices: Vec<Vec<usize>> = groups.iter().map(|(_, members)| members.clone()).collect();
    // Only indices that a task's cells have: a file may contain any number as an index.
    let mut indices_of: BTreeMap<TaskId, BTreeSet<u32>> = BTreeMap::new();
    for cell in cells {
        indices_of.entry(cell.condition.task).or_default().extend(cell.indices());
    }
    let indices_of: BTreeMap<TaskId, Vec<u32>> =
        indices_of.into_iter().map(|(task, indices)| (task, indices.into_iter().collect())).collect();
    let resampled = |cell: &&MatchedCell| BootstrapCell {
        task_idx: cell.condition.task as usize,
        differences: cell.differences(&indices_of[&cell.condition.task]),
    };
    let resampled: Vec<BootstrapCell> = cells.iter().map(resampled).collect();
    let estimates = cluster_bootstrap(&resampled, &indices, levels.alpha);
    let group = |((group, members), estimate): ((&Group, Vec<usize>), Option<Estimate>)| {
        let estimate = estimate?;
        Some(ComparedGroup {
            group: group.name().to_owned(),
            n: members.iter().map(|&idx| cells[idx].pairs().n()).sum(),
            verdict: judge(&estimate, levels),
            estimate,
        })
    };
    groups.into_iter().zip(estimates).filter_map(group).collect()
}

/// Judges a mean by its intervals.
fn judge(estimate: &Estimate, levels: Levels) -> Verdict {
    let ([low, high], narrow) = (estimate.interval, estimate.one_sided);
    let decision = if low > 0.0 {
        Decision::ABetter
    } else if high < 0.0 {
        Decision::BBetter
    } else if -levels.margin < narrow[0] && narrow[1] < levels.margin {
        Decision::Equivalent
    } else {
        Decision::Undecided
    };
    Verdict { decision, more_episodes: None }
}
