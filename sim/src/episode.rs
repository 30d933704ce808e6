//! Episodes: what defines one, and the progress of one.
//!
//! Where the actions come from, and when somebody looks, is left to those who run an episode: `serve`,
//! `vector`, `demo` and `show`.

use ipc_types::ControlMode;
use thiserror::Error;

use crate::perturb::{Composition, Language, Perturbation, Strength};
use crate::physics::{World, WorldState};
use crate::physics::fingerprint::Fingerprint;
use crate::predicate::{Predicate, first_unmet};
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

/// The physics state is no longer finite.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error("the physics state is not finite after step {step}")]
pub struct DivergedError {
    /// Number of control steps executed.
    pub step: u32,
}

/// An episode in progress: its world, and what has come of it so far.
pub(crate) struct Episode {
    pub(crate) world: World,
    success: Vec<Predicate>,
    fingerprint: Fingerprint,
    steps: u32,
    first_success_step: Option<u32>,
    /// First predicate that does not hold in the current state.
    unmet: Option<Predicate>,
}

impl Episode {
    /// Starts an episode in the present state of a world.
    pub(crate) fn new(world: World, success: Vec<Predicate>) -> Self {
        let mut fingerprint = Fingerprint::default();
        world.hash_state(&mut fingerprint);
        let unmet = first_unmet(&success, &world);
        Self { world, success, fingerprint, steps: 0, first_success_step: None, unmet }
    }

    /// Starts the episode anew from a state of its world.
    pub(crate) fn restart(&mut self, state: &WorldState) {
        self.world.set_state(state);
        self.fingerprint = Fingerprint::default();
        self.world.hash_state(&mut self.fingerprint);
        self.unmet = first_unmet(&self.success, &self.world);
        (self.steps, self.first_success_step) = (0, None);
    }

    /// Executes an action row, `[action_dim]`.
    pub(crate) fn step(&mut self, row: &[f32]) -> Result<(), DivergedError> {
        self.world.step(row);
        self.steps += 1;
        self.fingerprint.write(row);
        self.world.hash_state(&mut self.fingerprint);
        if !self.world.is_finite() {
            return Err(DivergedError { step: self.steps });
        }
        self.unmet = first_unmet(&self.success, &self.world);
        if self.unmet.is_none() {
            self.first_success_step.get_or_insert(self.steps);
        }
        Ok(())
    }

    /// Returns the number of control steps executed.
    pub(crate) const fn steps(&self) -> u32 {
        self.steps
    }

    /// Returns the first step after which all success predicates held, counted from 1.
    pub(crate) const fn first_success_step(&self) -> Option<u32> {
        self.first_success_step
    }

    /// Returns the first success predicate that does not hold in the current state.
    pub(crate) const fn unmet(&self) -> Option<Predicate> {
        self.unmet
    }

    /// Returns the hash of the initial state, then every executed row and the state after it.
    pub(crate) fn fingerprint(&self) -> u64 {
        self.fingerprint.finish()
    }
}
