//! Demonstrations: what experts do, in the control mode that policies are trained in.
//!
//! An episode is stepped first and drawn only if it is wanted: its frames keep where everything was. The same action rows give
//! the same episode again, bit for bit ([`Recording::replay`]).

mod track;

use ipc_types::ControlMode;
use ipc_types::layout::MAX_ACTION_DIM;
use thiserror::Error;

use crate::expert::{self, Expert, MotionPlanError};
use crate::fingerprint::Fingerprint;
use crate::physics::World;
use crate::predicate::{Predicate, first_unmet};
use crate::scene::{Scene, Snapshot};
use crate::show::Subject;

/// Why there is no recording of an episode.
#[derive(Debug, Error)]
pub enum DemoError {
    /// The expert's moves are out of reach.
    #[error("the expert found no plan: {0}")]
    Plan(#[from] MotionPlanError),
    /// The world blew up.
    #[error("the physics state is not finite after step {step}")]
    NotFinite {
        /// Control steps until then.
        step: u32,
    },
    /// Experts' plans are not told in this mode.
    #[error("demonstrations are made in pd_joint_pos or, with one arm, pd_ee_delta_pose, not in {mode}")]
    Mode {
        /// The mode asked for.
        mode: &'static str,
    },
}

/// An episode, frame by frame: what was seen before each action row, and the row.
pub struct Recording {
    scene: Scene,
    mode: ControlMode,
    /// `[n_frames, action_dim]`.
    actions: Vec<f32>,
    /// `[n_frames, state_dim]`: before the action.
    states: Vec<f32>,
    /// Before the action.
    snapshots: Vec<Snapshot>,
    n_states: usize,
    success_at_end: bool,
    fingerprint: u64,
}

impl Recording {
    /// The expert's episode in this mode: until its plan is over and has succeeded, or the episode's end.
    ///
    /// # Errors
    /// If the expert has no plan or the world blows up, or plans are not told in this mode.
    pub fn of_expert(subject: Subject, episode_seed: u64, mode: ControlMode) -> Result<Self, DemoError> {
        let task = subject.task.task();
        let scene = subject.draw(episode_seed);
        let mut expert = Expert::new(&scene, &(task.expert)(&scene))?;
        let teller = track::teller(mode, task.morphology).ok_or(DemoError::Mode { mode: mode.name() })?;
        let mut stage = Stage::new(subject, scene, mode);
        let mut planned = [0.0; MAX_ACTION_DIM];
        let planned = &mut planned[..expert::CONTROL_MODE.action_dim(task.morphology)];
        let mut plan_steps = 0;
        while stage.steps() < task.max_steps && (plan_steps < expert.n_steps() || !stage.has_succeeded()) {
            expert.act(&stage.world, planned);
            plan_steps += 1;
            let mut repeats = 0;
            loop {
                let mut row = [0.0; MAX_ACTION_DIM];
                let row = &mut row[..mode.action_dim(task.morphology)];
                let in_full = teller(planned, &stage.world, row);
                stage.step(row)?;
                repeats += 1;
                if in_full || repeats == track::MOST_REPEATS || stage.steps() == task.max_steps {
                    break;
                }
            }
        }
        Ok(stage.finish())
    }

    /// The episode that these action rows `[n_frames, action_dim]` make.
    ///
    /// # Errors
    /// If the world blows up.
    ///
    /// # Panics
    /// If the rows are not whole.
    pub fn replay(
        subject: Subject,
        episode_seed: u64,
        mode: ControlMode,
        actions: &[f32],
    ) -> Result<Self, DemoError> {
        let action_dim = mode.action_dim(subject.task.task().morphology);
        assert!(actions.len().is_multiple_of(action_dim), "rows of {action_dim} numbers");
        let mut stage = Stage::new(subject, subject.draw(episode_seed), mode);
        actions.chunks_exact(action_dim).try_for_each(|row| stage.step(row))?;
        Ok(stage.finish())
    }

    /// Frames, which is control steps.
    #[must_use]
    pub fn n_frames(&self) -> usize {
        self.snapshots.len()
    }

    /// How the action rows are meant.
    #[must_use]
    pub fn mode(&self) -> ControlMode {
        self.mode
    }

    /// `[n_frames, action_dim]`.
    #[must_use]
    pub fn actions(&self) -> &[f32] {
        &self.actions
    }

    /// `[n_frames, state_dim]`: what a policy was told of the arms before each action (spec/env.md §6).
    #[must_use]
    pub fn states(&self) -> &[f32] {
        &self.states
    }

    /// What a policy was told to do.
    #[must_use]
    pub fn instruction(&self) -> &str {
        &self.scene.instruction
    }

    /// Whether everything that makes success held after the last step.
    #[must_use]
    pub fn success_at_end(&self) -> bool {
        self.success_at_end
    }

    /// Hash of the start, the actions and what came of them, as a run makes it of its episodes.
    #[must_use]
    pub fn fingerprint(&self) -> u64 {
        self.fingerprint
    }

    /// The episode's scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Where everything was at a frame.
    ///
    /// # Panics
    /// If there is no such frame.
    #[must_use]
    pub fn snapshot(&self, frame: usize) -> &Snapshot {
        &self.snapshots[frame]
    }
}

/// An episode in progress.
struct Stage {
    recording: Recording,
    world: World,
    success: Vec<Predicate>,
    fingerprint: Fingerprint,
}

impl Stage {
    fn new(subject: Subject, scene: Scene, mode: ControlMode) -> Self {
        let task = subject.task.task();
        let world = World::build(&scene, mode);
        let mut fingerprint = Fingerprint::default();
        world.absorb(&mut fingerprint);
        Self {
            success: (task.success)(&scene, subject.profile),
            recording: Recording {
                scene,
                mode,
                actions: Vec::new(),
                states: Vec::new(),
                snapshots: Vec::new(),
                n_states: task.morphology.state_dim(),
                success_at_end: false,
                fingerprint: 0,
            },
            world,
            fingerprint,
        }
    }

    fn steps(&self) -> u32 {
        self.recording.snapshots.len() as u32
    }

    fn has_succeeded(&self) -> bool {
        first_unmet(&self.success, &self.world).is_none()
    }

    fn step(&mut self, row: &[f32]) -> Result<(), DemoError> {
        let Self { recording, world, fingerprint, .. } = self;
        let mut snapshot = Snapshot::identity(recording.scene.bodies.len(), recording.scene.robots.len());
        world.write_snapshot(&mut snapshot);
        recording.snapshots.push(snapshot);
        let first = recording.states.len();
        recording.states.resize(first + recording.n_states, 0.0);
        world.write_state(&mut recording.states[first..]);
        recording.actions.extend_from_slice(row);
        world.step(row);
        fingerprint.write(row);
        world.absorb(fingerprint);
        if world.is_finite() { Ok(()) } else { Err(DemoError::NotFinite { step: self.steps() }) }
    }

    fn finish(self) -> Recording {
        let success_at_end = self.has_succeeded();
        Recording { success_at_end, fingerprint: self.fingerprint.finish(), ..self.recording }
    }
}
