//! A comparison of two sides on matched episodes: every cell, groups of cells, and verdicts.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use sim::TaskId;
use sim::perturb::Composition;
use thiserror::Error;

use crate::selection::condition::Condition;
use crate::statistics::{
    Decision, DifferenceCell, Judgement, Levels, MeanDifference, PairRates, PairedSequence, Pairs,
    TestedDifference, Verdict, equivalence_p, judge, mcnemar_mid_p, n_open_tests, tango_interval,
};
use crate::study::analysis::effects::MIN_SUCCESS;
use crate::study::analysis::evaluation::{Evaluation, EvaluationError};
use crate::study::analysis::flips::{Flip, flips};
use crate::study::analysis::groups::Group;
use crate::study::analysis::matching::{MatchedCell, Metric, Side, match_cells};

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
    /// p-value of a difference of at least the margin, adjusted in the same way.
    pub(crate) adjusted_equivalence_p: f64,
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
    pub(crate) estimate: MeanDifference,
    /// p-values adjusted by Holm's method for all groups of the comparison.
    pub(crate) adjusted_p: f64,
    pub(crate) adjusted_equivalence_p: f64,
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
        let conditions: Vec<Condition> = cells.iter().map(|cell| cell.condition).collect();
        let groups = Group::of_policies(&conditions);
        let kind = ComparisonKind::Policies { a: a.to_owned(), b: b.to_owned() };
        let ended_early = sides.iter().any(|side| side.policy.ended_early);
        Self::new(evaluation, kind, (&cells, ended_early), &groups, options)
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
        Self::new(evaluation, kind, (&cells, own.ended_early), &groups, options)
    }

    fn new(
        evaluation: &Evaluation,
        sides: ComparisonKind,
        (matched, ended_early): (&[MatchedCell], bool),
        groups: &[Group],
        options: ComparisonOptions,
    ) -> Result<Self, ComparisonError> {
        let ComparisonOptions { metric, levels, max_flips } = options;
        let matched: Vec<&MatchedCell> = matched.iter().filter(|cell| !cell.episodes.is_empty()).collect();
        if matched.is_empty() {
            let [a, b] = sides.names();
            return Err(ComparisonError::NothingInCommon { a, b });
        }
        let tests = if ended_early { TestKind::Sequential } else { TestKind::FixedSample };
        let (cells, groups) = match tests {
            TestKind::FixedSample => {
                let counts = |cell: &&&MatchedCell| sides.counts_for_means(&cell.pairs());
                let averaged: Vec<&MatchedCell> = matched.iter().filter(counts).copied().collect();
                (fixed_sample_cells(&matched, levels), compared_groups(&averaged, groups, levels))
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
    /// Returns `true` if a cell counts for means. For what a policy loses, it must have something to lose.
    fn counts_for_means(&self, pairs: &Pairs) -> bool {
        let [_, before] = pairs.successes().map(f64::from);
        matches!(self, Self::Policies { .. }) || before >= MIN_SUCCESS * f64::from(pairs.n())
    }

    /// Returns the names of both sides for people.
    pub(crate) fn names(&self) -> [String; 2] {
        match self {
            Self::Policies { a, b } => [a.clone(), b.clone()],
            Self::Perturbations { policy, against } => {
                [format!("{policy} under the perturbation"), format!("{policy} under {against}")]
            }
        }
    }

    /// Returns short names of both sides.
    pub(crate) fn short_names(&self) -> [&str; 2] {
        match self {
            Self::Policies { a, b } => [a, b],
            Self::Perturbations { against, .. } => ["perturbed", against],
        }
    }

    /// Formats a verdict for people. A policy under perturbations gains or loses something.
    pub(crate) fn verdict(&self, verdict: &Verdict, difference: f64, margin: f64) -> String {
        let points = 100.0 * difference.abs();
        match (self, verdict.decision) {
            (Self::Perturbations { .. }, Decision::ABetter) => format!("gains {points:.1} points"),
            (Self::Perturbations { .. }, Decision::BBetter) => format!("loses {points:.1} points"),
            (Self::Perturbations { .. }, Decision::Equivalent) => {
                format!("changes by less than {:.1} points", 100.0 * margin)
            }
            _ => verdict.text(self.short_names(), margin),
        }
    }

    /// Formats the numbers of cells by decision for people.
    pub(crate) fn counts(
        &self,
        [a_better, b_better, equivalent, undecided]: [usize; 4],
        margin: f64,
    ) -> String {
        let margin = 100.0 * margin;
        match self {
            Self::Policies { a, b } => format!(
                "{a} better in {a_better}, {b} better in {b_better}, no difference larger than {margin:.1} pp in \
                 {equivalent}, undecided in {undecided}"
            ),
            Self::Perturbations { policy, .. } => format!(
                "{policy} loses in {b_better}, gains in {a_better}, changes by less than {margin:.1} points in \
                 {equivalent}, undecided in {undecided}"
            ),
        }
    }
}

/// Compares cells whose number of episodes was fixed beforehand.
fn fixed_sample_cells(matched: &[&MatchedCell], levels: Levels) -> Vec<ComparedCell> {
    let pairs: Vec<Pairs> = matched.iter().map(|cell| cell.pairs()).collect();
    let test = |pairs: &Pairs| TestedDifference {
        difference: pairs.difference().unwrap_or(0.0),
        p: mcnemar_mid_p(pairs),
        equivalence_p: equivalence_p(pairs, levels.margin),
    };
    let tested: Vec<TestedDifference> = pairs.iter().map(test).collect();
    let judged = judge(&tested, levels.alpha);
    let n_tests = n_open_tests(&judged, levels.alpha);
    let cells = matched.iter().zip(pairs).zip(tested.iter().zip(&judged));
    let cell = |((cell, pairs), row): ((&&MatchedCell, Pairs), _)| {
        let interval = tango_interval(&pairs, levels.z()).unwrap_or([-1.0, 1.0]);
        let rates = PairRates::of_cell(&pairs);
        let more = || rates.and_then(|rates| more(rates.pairs_needed(levels, n_tests), f64::from(pairs.n())));
        compared(cell, pairs, row, interval, more)
    };
    cells.map(cell).collect()
}

/// Compares cells that may have ended when they were decided.
fn sequential_cells(matched: &[&MatchedCell], levels: Levels) -> Vec<ComparedCell> {
    let sequences: Vec<PairedSequence> = matched.iter().map(|cell| cell.sequence(levels)).collect();
    let tested: Vec<TestedDifference> = sequences.iter().map(PairedSequence::tested).collect();
    let judged = judge(&tested, levels.alpha);
    let cells = matched.iter().zip(&sequences).zip(tested.iter().zip(&judged));
    cells
        .map(|((cell, sequence), row)| compared(cell, *sequence.pairs(), row, sequence.interval(), || None))
        .collect()
}

/// Returns how many pairs are missing.
fn more(needed: f64, n: f64) -> Option<u64> {
    needed.is_finite().then(|| (needed - n).ceil().max(1.0) as u64)
}

fn compared(
    cell: &MatchedCell,
    pairs: Pairs,
    (tested, judged): (&TestedDifference, &Judgement),
    interval: [f64; 2],
    more_episodes: impl FnOnce() -> Option<u64>,
) -> ComparedCell {
    ComparedCell {
        condition: cell.condition,
        n: pairs.n(),
        successes: pairs.successes(),
        difference: tested.difference,
        interval,
        p: tested.p,
        adjusted_p: judged.adjusted_p,
        adjusted_equivalence_p: judged.adjusted_equivalence_p,
        verdict: verdict(judged.decision, more_episodes),
        pairs,
        n_errors: cell.n_errors,
        n_unmatched: cell.n_unmatched,
    }
}

fn verdict(decision: Decision, more_episodes: impl FnOnce() -> Option<u64>) -> Verdict {
    let is_undecided = decision == Decision::Undecided;
    Verdict { decision, more_episodes: if is_undecided { more_episodes() } else { None } }
}

/// Averages the cells of each group that has any.
fn compared_groups(cells: &[&MatchedCell], groups: &[Group], levels: Levels) -> Vec<ComparedGroup> {
    let conditions: Vec<Condition> = cells.iter().map(|cell| cell.condition).collect();
    let mut starts_of: BTreeMap<TaskId, BTreeSet<(u64, u32)>> = BTreeMap::new();
    for cell in cells {
        let starts = cell.episodes.iter().map(|pair| pair.start);
        starts_of.entry(cell.condition.task).or_default().extend(starts);
    }
    let starts_of: BTreeMap<TaskId, Vec<(u64, u32)>> =
        starts_of.into_iter().map(|(task, starts)| (task, starts.into_iter().collect())).collect();
    let differences = |cell: &&MatchedCell| DifferenceCell {
        task_idx: cell.condition.task as usize,
        differences: cell.differences(&starts_of[&cell.condition.task]),
    };
    let differences: Vec<DifferenceCell> = cells.iter().map(differences).collect();
    let estimate = |group: &Group| {
        let members = group.members(&conditions);
        let own: Vec<(f64, &DifferenceCell)> =
            members.iter().map(|&(weight, idx)| (weight, &differences[idx])).collect();
        Some((group.name(), members, MeanDifference::new(&own, levels)?))
    };
    type Averaged = (String, Vec<(f64, usize)>, MeanDifference);
    let groups: Vec<Averaged> = groups.iter().filter_map(estimate).collect();
    let tested: Vec<TestedDifference> = groups.iter().map(|(_, _, estimate)| estimate.tested()).collect();
    let judged = judge(&tested, levels.alpha);
    let n_tests = n_open_tests(&judged, levels.alpha);
    let group = |((group, members, estimate), judged): (Averaged, &Judgement)| {
        let n: u32 = members.iter().map(|&(_, idx)| cells[idx].pairs().n()).sum();
        let per_cell = f64::from(n) / members.len() as f64;
        let needed = || estimate.rates().pairs_needed(levels, n_tests) / estimate.n_effective * per_cell;
        ComparedGroup {
            group,
            n,
            adjusted_p: judged.adjusted_p,
            adjusted_equivalence_p: judged.adjusted_equivalence_p,
            verdict: verdict(judged.decision, || more(needed(), per_cell)),
            estimate,
        }
    };
    groups.into_iter().zip(&judged).map(group).collect()
}
