//! Episodes that run without a policy host.

use ipc_types::ControlMode;
use ipc_types::layout::MAX_ACTION_DIM;

use super::error::ShowError;
use super::status::EpisodeStatus;
use crate::expert::{Expert, MotionPlanError, write_hold_action};
use crate::perturb::{Composition, Language, Perturbation, Strength};
use crate::physics::World;
use crate::predicate::first_unmet;
use crate::task::Task;
use crate::task::profile::Profile;
use crate::tasks::TaskId;
use scene::{Scene, Snapshot};

/// A distribution of episodes. Together with a seed it determines an episode.
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

/// Source of the actions of a rollout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Actor {
    /// The task's scripted expert.
    Expert,
    /// Commands that hold the arms still.
    Idle,
}

/// Writes the next action row, `[8 per arm] f32`.
type ActFn = Box<dyn FnMut(&World, &mut [f32])>;

/// Condition that ends a rollout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RolloutEnd {
    /// The first success, or the episode's step limit.
    FirstSuccess,
    /// The episode's step limit.
    StepLimit,
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

    /// Samples the scene of an episode.
    pub(crate) fn draw(self, episode_seed: u64) -> Scene {
        self.perturbation.spec(self.task.task(), self.profile, self.strength).draw(episode_seed)
    }

    /// Draws the instruction of an episode from the sentences of a run.
    #[must_use]
    pub fn instruction(self, language: &Language, episode_seed: u64) -> String {
        let mut spec = self.perturbation.spec(self.task.task(), self.profile, self.strength);
        language.apply(self.task.task(), self.profile, &mut spec);
        spec.instruction.draw(episode_seed)
    }

    /// Rolls out an episode. Returns the initial snapshot followed by one snapshot per control step, and the
    /// outcome.
    pub(crate) fn roll_out(
        self,
        scene: &Scene,
        actor: Actor,
        end: RolloutEnd,
    ) -> Result<(Vec<Snapshot>, EpisodeStatus), ShowError> {
        let task = self.task.task();
        let mut act = actor.act_fn(task, scene)?;
        let mut world = World::build(scene, ControlMode::JointPos);
        let success = (task.success)(scene, self.profile);
        let mut row = [0.0; MAX_ACTION_DIM];
        let row = &mut row[..ControlMode::JointPos.action_dim(task.morphology)];
        let mut first_success = None;
        let mut snapshots = vec![snapshot(scene, &world)];
        for step in 1..=task.max_steps {
            act(&world, row);
            world.step(row);
            if !world.is_finite() {
                return Err(ShowError::NotFinite { step });
            }
            snapshots.push(snapshot(scene, &world));
            if first_success.is_none() && first_unmet(&success, &world).is_none() {
                first_success = Some(step);
                if end == RolloutEnd::FirstSuccess {
                    break;
                }
            }
        }
        let n_steps = snapshots.len() as u32 - 1;
        Ok((snapshots, EpisodeStatus { first_success, n_steps }))
    }
}

impl Actor {
    /// All actors, in the order of the command-line help.
    pub const ALL: [Self; 2] = [Self::Expert, Self::Idle];

    /// Returns the name on the command line: that of the policy that behaves the same way in a run.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Expert => "expert",
            Self::Idle => "idle",
        }
    }

    fn act_fn(self, task: &Task, scene: &Scene) -> Result<ActFn, MotionPlanError> {
        Ok(match self {
            Self::Expert => {
                let mut expert = Expert::new(scene, &(task.expert)(scene))?;
                Box::new(move |world, row| expert.act(world, row))
            }
            Self::Idle => Box::new(write_hold_action),
        })
    }
}

/// Returns the current poses of all bodies and links of a world.
pub(crate) fn snapshot(scene: &Scene, world: &World) -> Snapshot {
    let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
    world.write_snapshot(&mut snapshot);
    snapshot
}
