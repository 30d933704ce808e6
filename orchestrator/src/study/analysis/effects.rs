//! The effect of perturbations on a policy: changes against the unperturbed tasks, averaged as in the
//! benchmark's figures, for each robot.

use ipc_types::Morphology;
use serde::Serialize;
use sim::perturb::{Composition, Modality};
use sim::{Perturbation, TaskId};

use crate::selection::condition::Condition;

/// Minimum unperturbed success rate of a task that counts for the changes.
pub(crate) const MIN_SUCCESS: f64 = 0.1;

/// The modalities over whose perturbations changes are averaged.
pub(crate) const MODALITIES: [Modality; 3] = [Modality::Vision, Modality::Language, Modality::Action];

/// The results of a policy under a perturbation, averaged over the tasks of one robot.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Effect {
    /// Name of the policy.
    pub(crate) policy: String,
    pub(crate) morphology: Morphology,
    pub(crate) perturbation: Composition,
    /// Mean success rate over all tasks that ran under the perturbation.
    pub(crate) success: f64,
    /// Number of tasks that count for the changes: those that also ran unperturbed, with a success rate of at
    /// least [`MIN_SUCCESS`].
    pub(crate) n_tasks: usize,
    /// Mean difference of the success rate over these tasks; `None` without tasks.
    pub(crate) change: Option<f64>,
    /// Mean of the difference relative to the unperturbed success rate over these tasks, and its standard
    /// deviation. Robustness, the perturbed rate over the unperturbed one, is 1 more.
    pub(crate) relative_change: Option<f64>,
    pub(crate) relative_deviation: Option<f64>,
}

/// The mean over the perturbations of a modality that were run, each with the same weight.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct ModalityEffect {
    /// Name of the policy.
    pub(crate) policy: String,
    pub(crate) morphology: Morphology,
    pub(crate) modality: Modality,
    /// Number of its perturbations that were run, and of all.
    pub(crate) n_run: usize,
    pub(crate) n_all: usize,
    /// Means of the fields of [`Effect`].
    pub(crate) success: f64,
    pub(crate) change: Option<f64>,
    pub(crate) relative_change: Option<f64>,
}

/// The difference of one policy's changes between the robots.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct EmbodimentDifference {
    /// Name of the policy.
    pub(crate) policy: String,
    /// Perturbations that were run with both.
    pub(crate) n_perturbations: usize,
    /// Mean of the absolute difference between the changes of one arm and of two.
    pub(crate) difference: f64,
}

/// The success rate of a policy under a condition.
#[derive(Clone, Debug)]
pub(crate) struct CellRate<'a> {
    /// Name of the policy.
    pub(crate) policy: &'a str,
    pub(crate) condition: Condition,
    /// Success rate; `None` without episodes.
    pub(crate) success: Option<f64>,
}

/// Returns the name of a robot for people.
pub(crate) fn morphology_name(morphology: Morphology) -> &'static str {
    match morphology {
        Morphology::Single => "single arm",
        Morphology::Bimanual => "bimanual",
    }
}

/// Returns the name of a modality for people.
pub(crate) fn modality_name(modality: Modality) -> &'static str {
    match modality {
        Modality::Vision => "vision",
        Modality::Language => "language",
        Modality::Action => "action",
        Modality::Mixed => "mixed",
    }
}

/// Computes the effects, sorted by policy (in the order of `cells`), robot and perturbation (in the order
/// of the suite). Returns none unless there are both perturbed and unperturbed results.
pub(crate) fn effects(cells: &[CellRate<'_>]) -> Vec<Effect> {
    let none = Composition::from(Perturbation::None);
    let mut policies: Vec<&str> = cells.iter().map(|cell| cell.policy).collect();
    let mut seen = std::collections::HashSet::new();
    policies.retain(|policy| seen.insert(*policy));
    let is_unperturbed = |cell: &CellRate<'_>| cell.condition.perturbation == none;
    if cells.iter().all(is_unperturbed) || !cells.iter().any(is_unperturbed) {
        return Vec::new();
    }
    let mut effects = Vec::new();
    for policy in policies {
        for morphology in Morphology::ALL {
            let is_own = |cell: &&CellRate<'_>| {
                cell.policy == policy && cell.condition.task.task().morphology == morphology
            };
            let own: Vec<&CellRate<'_>> = cells.iter().filter(is_own).collect();
            let mut perturbations: Vec<Composition> =
                own.iter().map(|cell| cell.condition.perturbation).collect();
            perturbations.sort_by_key(|perturbation| perturbation.iter().collect::<Vec<Perturbation>>());
            perturbations.dedup();
            let effect = |perturbation| effect(&own, (policy, morphology, perturbation));
            effects.extend(perturbations.into_iter().filter_map(effect));
        }
    }
    effects
}

fn effect(
    own: &[&CellRate<'_>],
    (policy, morphology, perturbation): (&str, Morphology, Composition),
) -> Option<Effect> {
    let rate = |task: TaskId, perturbation: Composition| {
        own.iter().find(|cell| cell.condition == Condition { task, perturbation })?.success
    };
    let cells = own.iter().filter(|cell| cell.condition.perturbation == perturbation);
    let all: Vec<(TaskId, f64)> =
        cells.filter_map(|cell| Some((cell.condition.task, cell.success?))).collect();
    let pairs =
        all.iter().filter_map(|(task, after)| Some((rate(*task, Perturbation::None.into())?, *after)));
    let pairs: Vec<(f64, f64)> = pairs.filter(|(before, _)| *before >= MIN_SUCCESS).collect();
    let relative: Vec<f64> = pairs.iter().map(|(before, after)| after / before - 1.0).collect();
    Some(Effect {
        policy: policy.to_owned(),
        morphology,
        perturbation,
        success: mean(all.iter().map(|(_, success)| *success))?,
        n_tasks: pairs.len(),
        change: mean(pairs.iter().map(|(before, after)| after - before)),
        relative_change: mean(relative.iter().copied()),
        relative_deviation: deviation(&relative),
    })
}

/// Averages the effects over the perturbations of each modality.
pub(crate) fn modality_effects(effects: &[Effect]) -> Vec<ModalityEffect> {
    let mut found = Vec::new();
    for own in effects.chunk_by(|a, b| (&a.policy, a.morphology) == (&b.policy, b.morphology)) {
        for modality in MODALITIES {
            let members: Vec<Composition> = Perturbation::ALL
                .iter()
                .filter(|perturbation| perturbation.modality() == Some(modality))
                .map(|perturbation| (*perturbation).into())
                .collect();
            let run: Vec<&Effect> =
                own.iter().filter(|effect| members.contains(&effect.perturbation)).collect();
            let Some(success) = mean(run.iter().map(|effect| effect.success)) else { continue };
            found.push(ModalityEffect {
                policy: own[0].policy.clone(),
                morphology: own[0].morphology,
                modality,
                n_run: run.len(),
                n_all: members.len(),
                success,
                change: mean(run.iter().filter_map(|effect| effect.change)),
                relative_change: mean(run.iter().filter_map(|effect| effect.relative_change)),
            });
        }
    }
    found
}

/// Compares the changes of each policy with one arm with those with two.
pub(crate) fn embodiment_differences(effects: &[Effect]) -> Vec<EmbodimentDifference> {
    let difference = |own: &[Effect]| {
        let changes = |morphology| {
            let perturbed = move |effect: &&Effect| {
                effect.morphology == morphology && effect.perturbation != Perturbation::None.into()
            };
            own.iter().filter(perturbed).filter_map(|effect| Some((effect.perturbation, effect.change?)))
        };
        let both = changes(Morphology::Single).filter_map(|(perturbation, single)| {
            let (_, bimanual) = changes(Morphology::Bimanual).find(|(other, _)| *other == perturbation)?;
            Some((single - bimanual).abs())
        });
        let both: Vec<f64> = both.collect();
        Some(EmbodimentDifference {
            policy: own[0].policy.clone(),
            n_perturbations: both.len(),
            difference: mean(both.iter().copied())?,
        })
    };
    effects.chunk_by(|a, b| a.policy == b.policy).filter_map(difference).collect()
}

pub(crate) fn mean(numbers: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, n) = numbers.fold((0.0, 0), |(sum, n), number| (sum + number, n + 1));
    (n > 0).then(|| sum / f64::from(n))
}

/// Returns the standard deviation of a sample; `None` for fewer than two numbers.
fn deviation(numbers: &[f64]) -> Option<f64> {
    let center = mean(numbers.iter().copied())?;
    let squares: f64 = numbers.iter().map(|number| (number - center).powi(2)).sum();
    (numbers.len() > 1).then(|| (squares / (numbers.len() as f64 - 1.0)).sqrt())
}
