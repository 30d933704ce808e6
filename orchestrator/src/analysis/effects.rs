//! The effect of perturbations on a policy: changes against the unperturbed tasks, averaged as in the
//! benchmark's figures.

use sim::Perturbation;
use sim::perturb::{Composition, Modality};

use crate::plan::Condition;

/// Minimum unperturbed success rate of a task that counts for the changes.
const MIN_SUCCESS: f64 = 0.1;

/// The results of a policy under a perturbation, averaged over tasks.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Effect {
    /// Name of the policy.
    pub(crate) policy: String,
    pub(crate) perturbation: Composition,
    /// Mean success rate over all tasks that ran under the perturbation.
    pub(crate) success_once: f64,
    /// Number of tasks that count for the changes: those that also ran unperturbed, with a success rate of at
    /// least [`MIN_SUCCESS`].
    pub(crate) n_tasks: usize,
    /// Mean difference of the success rate over these tasks; `None` without tasks.
    pub(crate) change: Option<f64>,
    /// Mean difference relative to the unperturbed success rate over these tasks; `None` without tasks.
    pub(crate) relative_change: Option<f64>,
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

/// Computes the effects, sorted by policy (in the order of `cells`) and perturbation (in the order of the
/// suite). Returns none unless there are both perturbed and unperturbed results.
pub(crate) fn effects(cells: &[CellRate<'_>]) -> Vec<Effect> {
    let none = Composition::from(Perturbation::None);
    let mut found: Vec<(&str, Composition)> = Vec::new();
    for cell in cells {
        let pair = (cell.policy, cell.condition.perturbation);
        if !found.contains(&pair) {
            found.push(pair);
        }
    }
    let is_compared = found.iter().any(|(_, perturbation)| *perturbation == none)
        && found.iter().any(|(_, perturbation)| *perturbation != none);
    if !is_compared {
        return Vec::new();
    }
    // Cells are sorted by task: a perturbation that does not apply to the first task appears late in them.
    let place = |perturbation: &Composition| perturbation.iter().collect::<Vec<Perturbation>>();
    let policies: Vec<&str> = found.iter().map(|(policy, _)| *policy).collect();
    let rank = |name: &str| policies.iter().position(|policy| *policy == name);
    found.sort_by_key(|(policy, perturbation)| (rank(policy), place(perturbation)));
    found.into_iter().filter_map(|(policy, perturbation)| effect(cells, policy, perturbation)).collect()
}

fn effect(cells: &[CellRate<'_>], policy: &str, perturbation: Composition) -> Option<Effect> {
    let none = Composition::from(Perturbation::None);
    let own = |perturbation: Composition| {
        let of_policy = cells.iter().filter(move |cell| cell.policy == policy);
        of_policy.filter(move |cell| cell.condition.perturbation == perturbation)
    };
    let all: Vec<f64> = own(perturbation).filter_map(|cell| cell.success).collect();
    let pairs = own(perturbation).filter_map(|cell| {
        let twin = own(none).find(|twin| twin.condition.task == cell.condition.task)?;
        Some((twin.success?, cell.success?))
    });
    let pairs: Vec<(f64, f64)> = pairs.filter(|(before, _)| *before >= MIN_SUCCESS).collect();
    Some(Effect {
        policy: policy.to_owned(),
        perturbation,
        success_once: mean(&all)?,
        n_tasks: pairs.len(),
        change: mean(&pairs.iter().map(|(before, after)| after - before).collect::<Vec<_>>()),
        relative_change: mean(&pairs.iter().map(|(before, after)| after / before - 1.0).collect::<Vec<_>>()),
    })
}

fn mean(numbers: &[f64]) -> Option<f64> {
    (!numbers.is_empty()).then(|| numbers.iter().sum::<f64>() / numbers.len() as f64)
}

/// Returns the mean change over all perturbations of a modality, as in the benchmark's figures:
/// unweighted, and a perturbation without results counts as no change. `None` without effects of that
/// policy.
pub(crate) fn modality_change(effects: &[Effect], policy: &str, modality: Modality) -> Option<f64> {
    let own: Vec<&Effect> = effects.iter().filter(|effect| effect.policy == policy).collect();
    if own.is_empty() {
        return None;
    }
    let members = Perturbation::ALL.iter().filter(|perturbation| perturbation.modality() == Some(modality));
    let change = |perturbation: &Perturbation| {
        let found = own.iter().find(|effect| effect.perturbation == (*perturbation).into());
        found.and_then(|effect| effect.change).unwrap_or(0.0)
    };
    mean(&members.map(change).collect::<Vec<_>>())
}
