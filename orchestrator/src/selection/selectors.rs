//! Parsing of task and perturbation names: single names, names joined by `+`, and keywords for groups.

use std::collections::BTreeSet;

use ipc_types::Morphology;
use sim::perturb::{Composition, CompositionError};
use sim::{Perturbation, TaskId};
use thiserror::Error;

use crate::selection::names::{NameParser, UnknownName, pick};

/// A task or a group of tasks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TaskSelector {
    /// Every task (`all`).
    All,
    /// Every task of a morphology (`single`, `bimanual`).
    Morphology(Morphology),
    /// A single task.
    Task(TaskId),
}

/// A perturbation, several that act together, or all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PerturbationSelector {
    /// Every single perturbation that applies to the task (`all`). The perturbation `All` is another one.
    Applicable,
    /// One perturbation, or several joined by `+`.
    Named(Composition),
}

/// Errors that can occur while parsing a perturbation.
#[derive(Debug, Error)]
pub(crate) enum PerturbationError {
    #[error(transparent)]
    Unknown(#[from] UnknownName),
    #[error(transparent)]
    Incompatible(#[from] CompositionError),
}

impl TaskSelector {
    /// Parser of one selector on the command line.
    pub(crate) const PARSER: NameParser<Self, UnknownName> = NameParser {
        parse: Self::parse,
        names: || [vec!["all", "single", "bimanual"], task_names()].concat(),
    };

    /// Returns the selected tasks in the order of the suite, each once. Without selectors, every task is
    /// selected.
    pub(crate) fn select(selectors: &[Self]) -> Vec<TaskId> {
        let is_selected = |task: &TaskId| {
            selectors.is_empty()
                || selectors.iter().any(|selector| match selector {
                    Self::All => true,
                    Self::Morphology(morphology) => task.task().morphology == *morphology,
                    Self::Task(selected) => task == selected,
                })
        };
        TaskId::ALL.iter().copied().filter(is_selected).collect()
    }

    fn parse(typed: &str) -> Result<Self, UnknownName> {
        match typed.trim() {
            "all" => Ok(Self::All),
            "single" => Ok(Self::Morphology(Morphology::Single)),
            "bimanual" => Ok(Self::Morphology(Morphology::Bimanual)),
            name => parse_task(name).map(Self::Task),
        }
    }
}

impl PerturbationSelector {
    /// Parser of one selector on the command line.
    pub(crate) const PARSER: NameParser<Self, PerturbationError> =
        NameParser { parse: Self::parse, names: || [vec!["all"], perturbation_names()].concat() };

    /// Returns the named perturbations, each once. Without selectors, this is the unperturbed condition.
    pub(crate) fn named(selectors: &[Self]) -> BTreeSet<Composition> {
        if selectors.is_empty() {
            return BTreeSet::from([Perturbation::None.into()]);
        }
        let named = |selector: &Self| match selector {
            Self::Applicable => None,
            Self::Named(perturbation) => Some(*perturbation),
        };
        selectors.iter().filter_map(named).collect()
    }

    fn parse(typed: &str) -> Result<Self, PerturbationError> {
        match typed.trim() {
            "all" => Ok(Self::Applicable),
            name => parse_perturbation(name).map(Self::Named),
        }
    }
}

/// Parser of a task on the command line.
pub(crate) const TASK_PARSER: NameParser<TaskId, UnknownName> =
    NameParser { parse: parse_task, names: task_names };

/// Parser of a perturbation, or several joined by `+`, on the command line.
pub(crate) const PERTURBATION_PARSER: NameParser<Composition, PerturbationError> =
    NameParser { parse: parse_perturbation, names: perturbation_names };

/// Parses the name of a task.
///
/// # Errors
/// If no task has that name.
pub(crate) fn parse_task(typed: &str) -> Result<TaskId, UnknownName> {
    pick("task", typed, TaskId::ALL, TaskId::name)
}

/// Parses the name of a perturbation, or of several joined by `+`, in our spelling or the benchmark's, such
/// as `MO_COLOR`.
///
/// # Errors
/// If a name is unknown or the perturbations cannot act together.
pub(crate) fn parse_perturbation(typed: &str) -> Result<Composition, PerturbationError> {
    let one = |name: &str| {
        let known = if name.eq_ignore_ascii_case("distractor_object") {
            Perturbation::DistractorObjects.name().to_owned()
        } else {
            name.replace('_', "-")
        };
        let picked = pick("perturbation", &known, Perturbation::ALL, Perturbation::name);
        picked.or_else(|_| pick("perturbation", name, Perturbation::ALL, Perturbation::name))
    };
    let parts = Composition::split(typed).map(one).collect::<Result<Vec<_>, _>>()?;
    Ok(Composition::new(&parts)?)
}

fn task_names() -> Vec<&'static str> {
    TaskId::ALL.iter().map(|task| task.name()).collect()
}

fn perturbation_names() -> Vec<&'static str> {
    Perturbation::ALL.iter().map(|perturbation| perturbation.name()).collect()
}
