//! Episodes that need no policy host: who acts in them, and where everything is after each of their steps.

use ipc_types::ControlMode;
use ipc_types::layout::MAX_ACTION_DIM;

use super::ShowError;
use crate::expert::{Expert, MotionPlanError, write_hold_action};
use crate::perturb::{Composition, Strength};
use crate::physics::World;
use crate::predicate::first_unmet;
use crate::profile::Profile;
use crate::scene::{Scene, Snapshot};
use crate::task::Task;
use crate::tasks::TaskId;

/// Which distribution of episodes is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Subject {
    /// Task.
    pub task: TaskId,
    /// Perturbation, or several that act together; they apply to the task.
    pub perturbation: Composition,
    /// How strong they are.
    pub strength: Strength,
    /// Profile.
    pub profile: Profile,
}

/// Who acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Script {
    /// The task's scripted expert.
    Expert,
    /// Nobody: the arms hold still.
    Idle,
}

type Actor = Box<dyn FnMut(&World, &mut [f32])>;

/// When to stop looking.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Until {
    /// After the first success, or at the episode's end without one.
    Success,
    /// At the episode's end.
    End,
}

impl Subject {
    /// The episode's scene.
    pub(crate) fn draw(self, episode_seed: u64) -> Scene {
        self.perturbation.spec(self.task.task(), self.profile, self.strength).draw(episode_seed)
    }

    /// The scene's start and what follows, one snapshot per control step.
    pub(super) fn roll_out(
        self,
        scene: &Scene,
        script: Script,
        until: Until,
    ) -> Result<Vec<Snapshot>, ShowError> {
        let task = self.task.task();
        let mut actor = script.actor(task, scene)?;
        let mut world = World::build(scene, ControlMode::JointPos);
        let success = (task.success)(scene, self.profile);
        let mut row = [0.0; MAX_ACTION_DIM];
        let row = &mut row[..ControlMode::JointPos.action_dim(task.morphology)];
        let mut snapshots = vec![snapshot(scene, &world)];
        for step in 1..=task.max_steps {
            actor(&world, row);
            world.step(row);
            if !world.is_finite() {
                return Err(ShowError::NotFinite { step });
            }
            snapshots.push(snapshot(scene, &world));
            if until == Until::Success && first_unmet(&success, &world).is_none() {
                break;
            }
        }
        Ok(snapshots)
    }
}

impl Script {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Expert, Self::Idle];

    /// Name on the command line: that of the policy which does the same in a run.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Expert => "expert",
            Self::Idle => "idle",
        }
    }

    /// What writes the next action row, `[8 per arm]` f32.
    fn actor(self, task: &Task, scene: &Scene) -> Result<Actor, MotionPlanError> {
        Ok(match self {
            Self::Expert => {
                let mut expert = Expert::new(scene, &(task.expert)(scene))?;
                Box::new(move |world, row| expert.act(world, row))
            }
            Self::Idle => Box::new(write_hold_action),
        })
    }
}

/// Where everything is now.
pub(super) fn snapshot(scene: &Scene, world: &World) -> Snapshot {
    let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
    world.write_snapshot(&mut snapshot);
    snapshot
}
