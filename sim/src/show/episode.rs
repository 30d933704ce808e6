//! Episodes that run without a policy host.

use ipc_types::ControlMode;
use ipc_types::layout::MAX_ACTION_DIM;

use super::error::ShowError;
use super::status::EpisodeStatus;
use crate::episode::EpisodeSpec;
use crate::expert::{Expert, MotionPlanError, write_hold_action};
use crate::physics::World;
use crate::task::Task;
use scene::{Scene, Snapshot};

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

/// Rolls out an episode. Returns the initial snapshot followed by one snapshot per control step, and the
/// outcome.
pub(crate) fn roll_out(
    spec: EpisodeSpec,
    scene: &Scene,
    actor: Actor,
    end: RolloutEnd,
) -> Result<(Vec<Snapshot>, EpisodeStatus), ShowError> {
    let task = spec.task.task();
    let mut act = actor.act_fn(task, scene)?;
    let mut episode = spec.start(scene, ControlMode::JointPos);
    let mut row = [0.0; MAX_ACTION_DIM];
    let row = &mut row[..ControlMode::JointPos.action_dim(task.morphology)];
    let mut snapshots = vec![episode.world.snapshot()];
    while episode.steps() < task.max_steps {
        act(&episode.world, row);
        episode.step(row)?;
        snapshots.push(episode.world.snapshot());
        if end == RolloutEnd::FirstSuccess && episode.first_success_step().is_some() {
            break;
        }
    }
    Ok((snapshots, EpisodeStatus { first_success: episode.first_success_step(), n_steps: episode.steps() }))
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
