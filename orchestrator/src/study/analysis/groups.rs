//! Groups of cells over which differences are averaged.

use std::collections::HashMap;

use ipc_types::Morphology;
use sim::Perturbation;
use sim::perturb::{Composition, Modality};

use crate::selection::condition::Condition;
use crate::study::analysis::effects::{MODALITIES, modality_name, morphology_name};

/// A group of cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Group {
    kind: GroupKind,
    /// `None` for the tasks of both robots.
    morphology: Option<Morphology>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum GroupKind {
    /// All cells.
    Overall,
    /// Cells with perturbations of one modality only.
    Modality(Modality),
    /// Cells under one perturbation.
    Perturbation(Composition),
}

impl Group {
    /// Returns the groups of a comparison of two policies.
    pub(crate) fn of_policies(conditions: &[Condition]) -> Vec<Self> {
        let overall = Self { kind: GroupKind::Overall, morphology: None };
        let mut kinds = vec![GroupKind::Perturbation(Perturbation::None.into())];
        kinds.extend(MODALITIES.map(GroupKind::Modality));
        kinds.push(GroupKind::Perturbation(Perturbation::All.into()));
        std::iter::once(overall).chain(per_morphology(conditions, &kinds)).collect()
    }

    /// Returns the groups of a comparison of one policy with its own twins: by perturbation, then by
    /// modality.
    pub(crate) fn of_perturbations(conditions: &[Condition]) -> Vec<Self> {
        let mut perturbations: Vec<Composition> = conditions.iter().map(|cell| cell.perturbation).collect();
        perturbations.sort_unstable();
        perturbations.dedup();
        let mut kinds: Vec<GroupKind> = perturbations.into_iter().map(GroupKind::Perturbation).collect();
        kinds.extend(MODALITIES.map(GroupKind::Modality));
        per_morphology(conditions, &kinds).collect()
    }

    /// Returns the members with their weights. In a modality, every perturbation has the same weight and,
    /// in a perturbation, every task, as in the benchmark's figures.
    pub(crate) fn members(&self, conditions: &[Condition]) -> Vec<(f64, usize)> {
        let members: Vec<usize> =
            (0..conditions.len()).filter(|&idx| self.contains(&conditions[idx])).collect();
        let mut n_tasks: HashMap<Composition, f64> = HashMap::new();
        for &idx in &members {
            *n_tasks.entry(conditions[idx].perturbation).or_default() += 1.0;
        }
        let weight = |idx: usize| match self.kind {
            GroupKind::Modality(_) => 1.0 / n_tasks[&conditions[idx].perturbation],
            GroupKind::Overall | GroupKind::Perturbation(_) => 1.0,
        };
        members.into_iter().map(|idx| (weight(idx), idx)).collect()
    }

    fn contains(&self, condition: &Condition) -> bool {
        let perturbation = condition.perturbation;
        self.morphology.is_none_or(|morphology| condition.task.task().morphology == morphology)
            && match self.kind {
                GroupKind::Overall => true,
                GroupKind::Modality(modality) => {
                    perturbation.iter().all(|part| part.modality() == Some(modality))
                }
                GroupKind::Perturbation(one) => perturbation == one,
            }
    }

    /// Returns the perturbation or modality, and the robot if there is one.
    pub(crate) fn name(&self) -> String {
        let kind = match self.kind {
            GroupKind::Overall => "overall".to_owned(),
            GroupKind::Modality(modality) => modality_name(modality).to_owned(),
            GroupKind::Perturbation(perturbation) => perturbation.name(),
        };
        match self.morphology {
            Some(morphology) => format!("{kind}, {}", morphology_name(morphology)),
            None => kind,
        }
    }
}

/// Returns groups of these kinds for each robot.
fn per_morphology(conditions: &[Condition], kinds: &[GroupKind]) -> impl Iterator<Item = Group> {
    let has = |morphology: &Morphology| {
        conditions.iter().any(|condition| condition.task.task().morphology == *morphology)
    };
    let found: Vec<Morphology> = Morphology::ALL.into_iter().filter(has).collect();
    let groups = found.into_iter().flat_map(move |morphology| {
        kinds.iter().map(move |kind| Group { kind: *kind, morphology: Some(morphology) })
    });
    groups.collect::<Vec<_>>().into_iter()
}
