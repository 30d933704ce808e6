//! A results file in memory: its manifest, and one compact row per episode.

use std::collections::BTreeMap;
use std::path::PathBuf;

use rusqlite::types::Value as Cell;
use serde_json::{Map, Value};

use crate::run::stopping::StoppingRule;
use crate::selection::condition::Condition;
use crate::selection::policy::Identity;
use crate::store::results::columns::Column;
use crate::store::results::manifest::ENVIRONMENT;
use crate::store::stored_episode::format_fingerprint;

/// Index of a string in [`ResultsFile::texts`].
pub(crate) type TextIdx = u32;

/// A results file in memory, without recorded actions.
#[derive(Debug)]
pub(crate) struct ResultsFile {
    pub(crate) path: PathBuf,
    /// Everything in the manifest except the policies, by key.
    pub(crate) manifest: Map<String, Value>,
    /// The rule that ended cells early, if there was one.
    pub(crate) stopping: Option<StoppingRule>,
    /// Policies by name.
    pub(crate) policies: BTreeMap<String, Identity>,
    /// Rows, sorted by policy, task name, perturbation name and episode.
    pub(crate) rows: Vec<EpisodeRow>,
    /// Names of policies, failed predicates and error messages, each once.
    pub(crate) texts: Vec<String>,
    /// `true` if a run is writing to the file at this moment.
    pub(crate) in_use: bool,
}

/// One finished episode.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EpisodeRow {
    /// Name of the policy.
    pub(crate) policy: TextIdx,
    pub(crate) condition: Condition,
    /// Index of the episode under the suite seed.
    pub(crate) episode: u32,
    pub(crate) seed: u64,
    pub(crate) steps: u32,
    pub(crate) success_once: bool,
    pub(crate) success_at_end: bool,
    pub(crate) first_success_step: Option<u32>,
    /// First predicate that did not hold at the end.
    pub(crate) failed_predicate: Option<TextIdx>,
    /// `None` if the stored text is not a fingerprint.
    pub(crate) fingerprint: Option<u64>,
    /// The reason why the episode could not be run.
    pub(crate) error: Option<TextIdx>,
    /// Seconds of physics, rendering, policy and waiting.
    pub(crate) times_s: [f32; 4],
    /// `true` if the executed actions are stored.
    pub(crate) has_actions: bool,
}

impl EpisodeRow {
    /// Returns the seconds that the episode took, beside others.
    pub(crate) fn seconds(&self) -> f64 {
        self.times_s.iter().map(|part| f64::from(*part)).sum()
    }
}

impl ResultsFile {
    /// Returns the name of a row's policy.
    pub(crate) fn policy(&self, row: &EpisodeRow) -> &str {
        &self.texts[row.policy as usize]
    }

    /// Returns `true` if a rule may have ended the cells of a policy early.
    pub(crate) fn may_end_early(&self, policy: &str) -> bool {
        self.stopping.as_ref().is_some_and(|rule| rule.policies.iter().any(|name| name == policy))
    }

    /// Returns the episodes per second of the runs that made the file; `None` if it does not say.
    pub(crate) fn episodes_per_s(&self) -> Option<f64> {
        self.wall_s().map(|wall_s| self.rows.len() as f64 / wall_s)
    }

    /// Returns the wall time of the runs that made the file; `None` if it does not say.
    pub(crate) fn wall_s(&self) -> Option<f64> {
        let wall_s = self.manifest.get(ENVIRONMENT)?.get("wall_s")?.as_f64()?;
        (wall_s > 0.0).then_some(wall_s)
    }

    /// Returns the text of an index.
    pub(crate) fn text(&self, idx: TextIdx) -> &str {
        &self.texts[idx as usize]
    }

    /// Returns the value of a row in a column before the checksum.
    pub(crate) fn value(&self, row: &EpisodeRow, column: Column) -> Cell {
        let text = |idx: Option<TextIdx>| idx.map_or(Cell::Null, |idx| Cell::Text(self.text(idx).to_owned()));
        match column {
            Column::Policy => text(Some(row.policy)),
            Column::Task => Cell::Text(row.condition.task.name().to_owned()),
            Column::Perturbation => Cell::Text(row.condition.perturbation.name()),
            Column::Episode => Cell::from(row.episode),
            Column::Seed => Cell::from(row.seed.cast_signed()),
            Column::Steps => Cell::from(row.steps),
            Column::SuccessOnce => Cell::from(row.success_once),
            Column::SuccessAtEnd => Cell::from(row.success_at_end),
            Column::FirstSuccessStep => row.first_success_step.into(),
            Column::FailedPredicate => text(row.failed_predicate),
            Column::Fingerprint => row.fingerprint.map(format_fingerprint).into(),
            Column::Error => text(row.error),
            Column::PhysicsS => Cell::from(row.times_s[0]),
            Column::RenderS => Cell::from(row.times_s[1]),
            Column::PolicyS => Cell::from(row.times_s[2]),
            Column::WaitS => Cell::from(row.times_s[3]),
            Column::Checksum | Column::Actions => Cell::Null,
        }
    }
}
