//! Distributions of episodes.

use ipc_types::ControlMode;

use super::steps::Episode;
use crate::perturb::{Composition, Language, Perturbation, Strength};
use crate::physics::World;
use crate::task::profile::Profile;
use crate::tasks::TaskId;
use scene::{Scene, SceneSpec};

/// A distribution of episodes. Together with a seed it determines the start of an episode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EpisodeSpec {
    /// The task of the episodes.
    pub task: TaskId,
    /// One perturbation, or several in combination. All of them must apply to the task.
    pub perturbation: Composition,
    /// Strength of the perturbations.
    pub strength: Strength,
    /// Rules of the benchmark that apply.
    pub profile: Profile,
}

impl EpisodeSpec {
    /// Returns the names of the task and, if there is one, the perturbation.
    #[must_use]
    pub fn title(self) -> String {
        let (task, perturbation) = (self.task.name(), self.perturbation);
        if perturbation == Composition::from(Perturbation::None) {
            task.to_owned()
        } else {
            format!("{task}, {}", perturbation.name())
        }
    }

    /// Samples the scene of an episode, with the simulator's own sentences.
    pub(crate) fn draw(self, episode_seed: u64) -> Scene {
        self.perturbation.spec(self.task.task(), self.profile, self.strength).draw(episode_seed)
    }

    /// Samples the scene of an episode with the sentences of a run.
    pub(crate) fn draw_with(self, language: &Language, episode_seed: u64) -> Scene {
        self.scene_spec(language).draw(episode_seed)
    }

    /// Draws the instruction of an episode from the sentences of a run.
    #[must_use]
    pub fn instruction(self, language: &Language, episode_seed: u64) -> String {
        self.scene_spec(language).instruction.draw(episode_seed)
    }

    fn scene_spec(self, language: &Language) -> SceneSpec {
        let mut spec = self.perturbation.spec(self.task.task(), self.profile, self.strength);
        language.apply(self.task.task(), self.profile, &mut spec);
        spec
    }

    /// Starts an episode in a scene that this distribution has drawn.
    pub(crate) fn start(self, scene: &Scene, mode: ControlMode) -> Episode {
        Episode::new(World::build(scene, mode), (self.task.task().success)(scene, self.profile))
    }
}
