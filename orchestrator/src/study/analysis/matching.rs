//! Matching of episodes that share their start: those of two policies, or of one policy under two
//! perturbations.

use clap::ValueEnum;
use serde::Serialize;
use sim::perturb::Composition;

use crate::selection::condition::Condition;
use crate::statistics::{Levels, PairedSequence, Pairs};
use crate::store::results::{Column, EpisodeRow};
use crate::study::analysis::evaluation::{EvaluatedPolicy, Evaluation, RowIdx};

/// The success of an episode that is compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
pub(crate) enum Metric {
    /// Success after any step
    #[default]
    SuccessOnce,
    /// Success after the last step
    SuccessAtEnd,
}

/// One side of a comparison.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Side<'a> {
    pub(crate) policy: &'a EvaluatedPolicy,
    /// The perturbation of this side in every cell; `None` for the cell's own.
    pub(crate) perturbation: Option<Composition>,
}

/// The matched episodes of a cell.
#[derive(Clone, Debug)]
pub(crate) struct MatchedCell {
    pub(crate) condition: Condition,
    /// Episodes with a result on both sides, by seed and index.
    pub(crate) episodes: Vec<MatchedEpisode>,
    /// Matched episodes with an error on either side, which are left out.
    pub(crate) n_errors: u32,
    /// Episodes that only one side has.
    pub(crate) n_unmatched: u32,
    /// First index that is missing on either side, of a single seed. Episodes with an error are not missing.
    first_missing: u32,
}

/// An episode with its rows on both sides.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MatchedEpisode {
    /// Suite seed and index of the episode, which determine its start.
    pub(crate) start: (u64, u32),
    pub(crate) rows: [RowIdx; 2],
    /// Success of A and of B.
    pub(crate) success: [bool; 2],
}

impl Metric {
    pub(crate) fn of(self, row: &EpisodeRow) -> bool {
        match self {
            Self::SuccessOnce => row.success_once,
            Self::SuccessAtEnd => row.success_at_end,
        }
    }

    /// Returns the column name of the results file.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::SuccessOnce => Column::SuccessOnce.name(),
            Self::SuccessAtEnd => Column::SuccessAtEnd.name(),
        }
    }
}

impl MatchedCell {
    /// Counts the pairs by their outcomes.
    pub(crate) fn pairs(&self) -> Pairs {
        let mut pairs = Pairs::default();
        self.episodes.iter().for_each(|episode| pairs.add(episode.success[0], episode.success[1]));
        pairs
    }

    /// Returns the pairs in index order up to the first episode that is missing on either side. Early
    /// stopping leaves later ones by chance of timing.
    pub(crate) fn sequence(&self, levels: Levels) -> PairedSequence {
        let mut sequence = PairedSequence::new(levels);
        let leading = self.episodes.iter().take_while(|episode| episode.start.1 < self.first_missing);
        for MatchedEpisode { success: [a, b], .. } in leading {
            sequence.push(*a, *b);
        }
        sequence
    }

    /// Returns `a − b` for each of the ascending `starts`.
    pub(crate) fn differences(&self, starts: &[(u64, u32)]) -> Vec<Option<i8>> {
        let mut pairs = self.episodes.iter().peekable();
        let difference = |start: &(u64, u32)| {
            let MatchedEpisode { success: [a, b], .. } = pairs.next_if(|pair| pair.start == *start)?;
            Some(i8::from(*a) - i8::from(*b))
        };
        starts.iter().map(difference).collect()
    }
}

/// Matches the episodes of A with those of B in every cell that A has and B can stand against. A cell in
/// which both sides are the same condition of the same policy is left out.
pub(crate) fn match_cells(
    evaluation: &Evaluation,
    [a, b]: [Side<'_>; 2],
    metric: Metric,
) -> Vec<MatchedCell> {
    let theirs = evaluation.conditions(b.policy);
    let cells = evaluation.conditions(a.policy).into_iter().filter_map(|(condition, ours)| {
        let perturbation = b.perturbation.unwrap_or(condition.perturbation);
        let other = Condition { task: condition.task, perturbation };
        if other == condition && a.policy.name == b.policy.name {
            return None;
        }
        let (_, theirs) = theirs.iter().find(|(condition, _)| *condition == other)?;
        Some(match_cell(evaluation, condition, [ours, theirs], metric))
    });
    cells.collect()
}

fn match_cell(
    evaluation: &Evaluation,
    condition: Condition,
    [ours, theirs]: [&[RowIdx]; 2],
    metric: Metric,
) -> MatchedCell {
    let mut cell =
        MatchedCell { condition, episodes: Vec::new(), n_errors: 0, n_unmatched: 0, first_missing: 0 };
    let (mut left, mut right) = (ours.iter().peekable(), theirs.iter().peekable());
    while let (Some(&&a_idx), Some(&&b_idx)) = (left.peek(), right.peek()) {
        let [a, b] = [a_idx, b_idx].map(|idx| evaluation.row(idx));
        let starts = [a_idx, b_idx].map(|idx| evaluation.start(idx));
        if starts[0] != starts[1] {
            cell.n_unmatched += 1;
            let behind = if starts[0] < starts[1] { &mut left } else { &mut right };
            behind.next();
            continue;
        }
        left.next();
        right.next();
        cell.first_missing += u32::from(a.episode == cell.first_missing);
        if a.error.is_some() || b.error.is_some() {
            cell.n_errors += 1;
        } else {
            cell.episodes.push(MatchedEpisode {
                start: starts[0],
                rows: [a_idx, b_idx],
                success: [metric.of(a), metric.of(b)],
            });
        }
    }
    cell.n_unmatched += (left.count() + right.count()) as u32;
    cell
}
