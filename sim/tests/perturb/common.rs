//! Helpers shared by the perturbation tests.

use sim::perturb::{Composition, Modality, Strength};
use sim::scene::SceneSpec;
use sim::scene::stream::episode_seed;
use sim::{Perturbation, Profile, TaskId};

/// Returns a task's scene distribution under a perturbation at full strength.
pub(crate) fn perturbed(task: TaskId, perturbation: Perturbation) -> SceneSpec {
    Composition::from(perturbation).spec(task.task(), Profile::Strict, Strength::FULL)
}

/// Returns a task's unperturbed scene distribution.
pub(crate) fn nominal(task: TaskId) -> SceneSpec {
    (task.task().nominal)(Profile::Strict)
}

/// Iterates over the single perturbations: all but `None` and `All`.
pub(crate) fn singles() -> impl Iterator<Item = Perturbation> {
    let is_single = |p: &Perturbation| !matches!(p.modality(), None | Some(Modality::Mixed));
    Perturbation::ALL.iter().copied().filter(is_single)
}

pub(crate) fn applies(perturbation: Perturbation, task: TaskId) -> bool {
    perturbation.applies_to(&nominal(task)).is_ok()
}

/// Returns the seeds of a task's first `n` episodes.
pub(crate) fn seeds(task: TaskId, n: u32) -> impl Iterator<Item = u64> {
    (0..n).map(move |episode_idx| episode_seed(0, task.name(), episode_idx))
}
