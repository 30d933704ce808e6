//! A task under a perturbation: the condition of an episode.

use serde::ser::{Serialize, SerializeMap, Serializer};
use sim::perturb::Composition;
use sim::{Perturbation, Profile, TaskId};
use thiserror::Error;

use crate::selection::selectors::{parse_perturbation, parse_task};

/// A task under a perturbation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Condition {
    pub(crate) task: TaskId,
    pub(crate) perturbation: Composition,
}

/// The error of a perturbation that does not apply to a task.
#[derive(Debug, Error)]
#[error(
    "perturbation {perturbation} does not apply to {task}: {reason}; omit one of them, or use --perturbations all for \
     those that apply"
)]
pub(crate) struct ConditionError {
    task: &'static str,
    perturbation: &'static str,
    reason: String,
}

impl Serialize for Condition {
    /// Serializes the names of the task and the perturbation.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(2))?;
        map.serialize_entry("task", self.task.name())?;
        map.serialize_entry("perturbation", &self.perturbation.name())?;
        map.end()
    }
}

impl Condition {
    /// Makes the condition of `task` under `perturbation`.
    ///
    /// # Errors
    /// If the perturbation does not apply to the task.
    pub(crate) fn new(task: TaskId, perturbation: Composition) -> Result<Self, ConditionError> {
        perturbation.applies_to(&(task.task().nominal)(Profile::Strict)).map_err(|(part, error)| {
            ConditionError { task: task.name(), perturbation: part.name(), reason: error.reason }
        })?;
        Ok(Self { task, perturbation })
    }

    /// Returns the conditions of `task` under every single perturbation that applies to it.
    pub(crate) fn all_of(task: TaskId) -> impl Iterator<Item = Self> {
        Perturbation::ALL.iter().filter_map(move |&perturbation| Self::new(task, perturbation.into()).ok())
    }
}

/// Parses the names of a task and a perturbation.
///
/// # Errors
/// If a name is unknown or the perturbations cannot act together.
pub(crate) fn parse_condition(task: &str, perturbation: &str) -> anyhow::Result<Condition> {
    let task: TaskId = parse_task(task)?;
    let perturbation: Composition = parse_perturbation(perturbation)?;
    Ok(Condition { task, perturbation })
}
