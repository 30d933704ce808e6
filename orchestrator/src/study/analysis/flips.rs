//! Flips: matched episodes in which exactly one side succeeds.

use std::path::PathBuf;

use serde::Serialize;

use crate::selection::condition::Condition;
use crate::study::analysis::evaluation::Evaluation;
use crate::study::analysis::matching::{MatchedCell, MatchedEpisode};

/// A matched episode in which exactly one side succeeds.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Flip {
    /// The cell, with the condition of side A.
    #[serde(flatten)]
    pub(crate) condition: Condition,
    /// Index of the episode under the suite seed.
    pub(crate) episode: u32,
    /// `true` if A succeeds and B fails.
    pub(crate) a_succeeds: bool,
    /// Predicate that the failing side did not fulfil at the end.
    pub(crate) failed_predicate: Option<String>,
    /// The episodes of A and B.
    pub(crate) sides: [FlipSide; 2],
}

/// One side's episode of a flip.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct FlipSide {
    /// Results file that has the row.
    pub(crate) file: PathBuf,
    /// Name of the policy.
    pub(crate) policy: String,
    #[serde(flatten)]
    pub(crate) condition: Condition,
    /// Control step of the first success.
    pub(crate) first_success_step: Option<u32>,
    /// `true` if the executed actions are stored, so that the episode can be replayed.
    pub(crate) has_actions: bool,
}

impl Flip {
    /// Returns the command that shows the failing side, or how to get one.
    pub(crate) fn replay_command(&self) -> String {
        self.sides[usize::from(self.a_succeeds)].replay_command(self.episode)
    }
}

impl FlipSide {
    fn replay_command(&self, episode: u32) -> String {
        if !self.has_actions {
            return "its actions were not kept".to_owned();
        }
        let Condition { task, perturbation } = self.condition;
        format!(
            "hypogeum replay {} --policy {} --task {} --perturbation {} --index {episode} --movie flip.gif",
            self.file.display(),
            self.policy,
            task.name(),
            perturbation.name()
        )
    }
}

/// Returns the first `max` flips, by cell and episode.
pub(crate) fn flips(evaluation: &Evaluation, cells: &[&MatchedCell], max: usize) -> Vec<Flip> {
    let flipped = |cell: &&MatchedCell| {
        let condition = cell.condition;
        let episodes: Vec<MatchedEpisode> = cell
            .episodes
            .iter()
            .copied()
            .filter(|episode| episode.success[0] != episode.success[1])
            .collect();
        episodes.into_iter().map(move |episode| (condition, episode))
    };
    cells
        .iter()
        .flat_map(flipped)
        .take(max)
        .map(|(condition, episode)| flip(evaluation, condition, &episode))
        .collect()
}

fn flip(evaluation: &Evaluation, condition: Condition, episode: &MatchedEpisode) -> Flip {
    let side = |idx: usize| {
        let file = &evaluation.files[episode.rows[idx].file_idx as usize];
        let row = evaluation.row(episode.rows[idx]);
        FlipSide {
            file: file.path.clone(),
            policy: file.policy(row).to_owned(),
            condition: row.condition,
            first_success_step: row.first_success_step,
            has_actions: row.has_actions,
        }
    };
    let a_succeeds = episode.success[0];
    let failing = episode.rows[usize::from(a_succeeds)];
    let file = &evaluation.files[failing.file_idx as usize];
    Flip {
        condition,
        episode: episode.start.1,
        a_succeeds,
        failed_predicate: evaluation.row(failing).failed_predicate.map(|idx| file.text(idx).to_owned()),
        sides: [side(0), side(1)],
    }
}
