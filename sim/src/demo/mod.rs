//! Demonstrations: expert episodes in the control mode that policies are trained in.
//!
//! An episode is simulated first and rendered only if it is used, from the snapshots of its frames. Replaying
//! the same action rows reproduces the episode bit for bit ([`Recording::replay`]).

mod action_conversion;

use ipc_types::ControlMode;
use ipc_types::layout::MAX_ACTION_DIM;
use thiserror::Error;

use crate::episode::{DivergedError, Episode, EpisodeSpec};
use crate::expert::{self, Expert, MotionPlanError};
use crate::physics::Parameters;
use crate::show::EpisodeStatus;
use crate::tasks::TaskId;
use crate::trajectory::Start;
use scene::{Scene, Snapshot};

/// Errors that can occur while recording an episode.
#[derive(Debug, Error)]
pub enum DemoError {
    /// The expert's waypoints are not reachable.
    #[error("the expert found no plan")]
    Plan(#[from] MotionPlanError),
    /// The simulation diverged.
    #[error(transparent)]
    Diverged(#[from] DivergedError),
    /// Expert plans cannot be converted to this control mode.
    #[error("demonstrations are recorded in pd_joint_pos or, with one arm, pd_ee_delta_pose, not in {mode}")]
    Mode {
        /// Name of the requested mode.
        mode: &'static str,
    },
}

/// A recorded episode. Each frame consists of an action row and of the state before that action.
pub struct Recording {
    scene: Scene,
    mode: ControlMode,
    /// Action rows, `[n_frames, action_dim]`.
    actions: Vec<f32>,
    /// Robot states before each action, `[n_frames, state_dim]`.
    states: Vec<f32>,
    /// Poses before each action and after the last one, `[n_frames + 1]`.
    snapshots: Vec<Snapshot>,
    state_dim: usize,
    first_success: Option<u32>,
    success_at_end: bool,
    fingerprint: u64,
}

impl Recording {
    /// Records an expert episode in the given control mode. The episode ends with the plan, which goes on
    /// after the first success, or at the step limit.
    ///
    /// # Errors
    /// If the expert has no plan, the simulation diverges, or plans cannot be converted to the control mode.
    pub fn of_expert(spec: EpisodeSpec, episode_seed: u64, mode: ControlMode) -> Result<Self, DemoError> {
        let task = spec.task.task();
        let scene = spec.draw(episode_seed);
        let mut expert = Expert::new(&scene, &(task.expert)(&scene))?;
        let convert = action_conversion::converter(mode, task.morphology)
            .ok_or(DemoError::Mode { mode: mode.name() })?;
        let mut recorder = EpisodeRecorder::start(spec, scene, mode);
        let mut planned = [0.0; MAX_ACTION_DIM];
        let planned = &mut planned[..expert::CONTROL_MODE.action_dim(task.morphology)];
        for _ in 0..expert.n_steps() {
            expert.act(&recorder.episode.world, planned);
            let mut reaches_target = true;
            for _ in 0..action_conversion::MAX_REPEATS {
                if recorder.episode.steps() == task.max_steps {
                    return Ok(recorder.finish());
                }
                let mut row = [0.0; MAX_ACTION_DIM];
                let row = &mut row[..mode.action_dim(task.morphology)];
                // Like the original, repeats a row that was clamped even if the next action is not.
                reaches_target &= convert(planned, &recorder.episode.world, row);
                recorder.step(row)?;
                if reaches_target {
                    break;
                }
            }
        }
        Ok(recorder.finish())
    }

    /// Replays an episode from its action rows, `[n_frames, action_dim]`.
    ///
    /// # Errors
    /// If the simulation diverges.
    ///
    /// # Panics
    /// If the length of `actions` is not a multiple of `action_dim`.
    pub fn replay(
        spec: EpisodeSpec,
        episode_seed: u64,
        mode: ControlMode,
        actions: &[f32],
    ) -> Result<Self, DemoError> {
        let mut recorder = EpisodeRecorder::start(spec, spec.draw(episode_seed), mode);
        recorder.execute(actions)?;
        Ok(recorder.finish())
    }

    /// Records the motion from a start state under action rows, `[n_frames, action_dim]`.
    ///
    /// # Errors
    /// If the simulation diverges.
    ///
    /// # Panics
    /// If the length of `actions` is not a multiple of `action_dim`.
    pub fn from_start(start: &Start, actions: &[f32]) -> Result<Self, DemoError> {
        let world = start.world(&Parameters::default());
        let success = (start.task.task().success)(&start.scene, start.profile);
        let episode = Episode::new(world, success);
        let mut recorder = EpisodeRecorder::new(start.task, start.scene.clone(), start.mode, episode);
        recorder.execute(actions)?;
        Ok(recorder.finish())
    }

    /// Returns the number of frames, which is the number of control steps.
    #[must_use]
    pub fn n_frames(&self) -> usize {
        self.snapshots.len() - 1
    }

    /// Returns the control mode of the action rows.
    #[must_use]
    pub fn mode(&self) -> ControlMode {
        self.mode
    }

    /// Returns the action rows, `[n_frames, action_dim]`.
    #[must_use]
    pub fn actions(&self) -> &[f32] {
        &self.actions
    }

    /// Returns the proprioceptive state before each action, `[n_frames, state_dim]` (docs/benchmark.md,
    /// "Observations").
    #[must_use]
    pub fn states(&self) -> &[f32] {
        &self.states
    }

    /// Returns `true` if all success predicates held after the last step.
    #[must_use]
    pub fn success_at_end(&self) -> bool {
        self.success_at_end
    }

    /// Returns the number of control steps and the first after which all success predicates held.
    #[must_use]
    pub fn outcome(&self) -> EpisodeStatus {
        EpisodeStatus { first_success: self.first_success, n_steps: self.n_frames() as u32 }
    }

    /// Returns the fingerprint: a hash of the initial state, the actions and all resulting states, as
    /// computed in a run.
    #[must_use]
    pub fn fingerprint(&self) -> u64 {
        self.fingerprint
    }

    /// Returns the sampled scene of the episode.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Returns the poses of all bodies and links at a frame, or at the end for `n_frames`.
    ///
    /// # Panics
    /// If `frame` is greater than that.
    #[must_use]
    pub fn snapshot(&self, frame: usize) -> &Snapshot {
        &self.snapshots[frame]
    }
}

/// Steps an episode and records its frames.
struct EpisodeRecorder {
    recording: Recording,
    episode: Episode,
    action_dim: usize,
}

impl EpisodeRecorder {
    fn start(spec: EpisodeSpec, scene: Scene, mode: ControlMode) -> Self {
        let episode = spec.start(&scene, mode);
        Self::new(spec.task, scene, mode, episode)
    }

    fn new(task: TaskId, scene: Scene, mode: ControlMode, episode: Episode) -> Self {
        let morphology = task.task().morphology;
        Self {
            recording: Recording {
                scene,
                mode,
                actions: Vec::new(),
                states: Vec::new(),
                snapshots: Vec::new(),
                state_dim: morphology.state_dim(),
                first_success: None,
                success_at_end: false,
                fingerprint: 0,
            },
            episode,
            action_dim: mode.action_dim(morphology),
        }
    }

    fn execute(&mut self, actions: &[f32]) -> Result<(), DemoError> {
        let n = self.action_dim;
        assert!(actions.len().is_multiple_of(n), "{} values are not rows of {n}", actions.len());
        actions.chunks_exact(n).try_for_each(|row| self.step(row))
    }

    fn step(&mut self, row: &[f32]) -> Result<(), DemoError> {
        let Self { recording, episode, .. } = self;
        recording.snapshots.push(episode.world.snapshot());
        let first = recording.states.len();
        recording.states.resize(first + recording.state_dim, 0.0);
        episode.world.write_state(&mut recording.states[first..]);
        recording.actions.extend_from_slice(row);
        Ok(episode.step(row)?)
    }

    fn finish(self) -> Recording {
        let Self { mut recording, episode, .. } = self;
        recording.snapshots.push(episode.world.snapshot());
        Recording {
            first_success: episode.first_success_step(),
            success_at_end: episode.unmet().is_none(),
            fingerprint: episode.fingerprint(),
            ..recording
        }
    }
}
