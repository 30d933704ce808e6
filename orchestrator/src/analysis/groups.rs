//! Groups of cells over which differences are averaged.

use serde::Serialize;
use sim::Perturbation;
use sim::perturb::{Composition, Modality};

use crate::plan::Condition;

/// A group of cells.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Group {
    /// All cells.
    Overall,
    /// The unperturbed cells.
    Unperturbed,
    /// Cells with perturbations of vision only.
    Vision,
    /// Cells with perturbations of language only.
    Language,
    /// Cells with perturbations of action only.
    Action,
    /// Cells under the perturbation All.
    All,
    /// Cells under one perturbation, by name.
    Perturbation(String),
}

impl Group {
    /// The groups of a comparison of two policies.
    pub(crate) const OF_POLICIES: [Self; 6] =
        [Self::Overall, Self::Unperturbed, Self::Vision, Self::Language, Self::Action, Self::All];

    /// Returns the groups of a comparison of one policy with its own twins: by perturbation, then by
    /// modality.
    pub(crate) fn of_perturbations(conditions: &[Condition]) -> Vec<Self> {
        let mut perturbations: Vec<Composition> = conditions.iter().map(|cell| cell.perturbation).collect();
        perturbations.sort_unstable();
        perturbations.dedup();
        let single = perturbations.iter().map(|perturbation| Self::Perturbation(perturbation.name()));
        single.chain([Self::Vision, Self::Language, Self::Action, Self::Overall]).collect()
    }

    pub(crate) fn contains(&self, condition: &Condition) -> bool {
        let perturbation = condition.perturbation;
        let all_of = |modality| perturbation.iter().all(|part| part.modality() == Some(modality));
        match self {
            Self::Overall => true,
            Self::Unperturbed => perturbation == Perturbation::None.into(),
            Self::Vision => all_of(Modality::Vision),
            Self::Language => all_of(Modality::Language),
            Self::Action => all_of(Modality::Action),
            Self::All => perturbation == Perturbation::All.into(),
            Self::Perturbation(name) => perturbation.name() == *name,
        }
    }

    /// Returns the name for tables.
    pub(crate) fn name(&self) -> &str {
        match self {
            Self::Overall => "overall",
            Self::Unperturbed => "None",
            Self::Vision => "vision",
            Self::Language => "language",
            Self::Action => "action",
            Self::All => "All",
            Self::Perturbation(name) => name,
        }
    }
}
