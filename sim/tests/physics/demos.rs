//! Demonstrations: expert plans converted to the control modes that policies are trained in, and their
//! replay.

use ipc_types::{ControlMode, Morphology};
use rayon::prelude::*;
use sim::demo::{DemoError, Recording};
use sim::episode::EpisodeSpec;
use sim::perturb::{Composition, Strength};
use sim::robot::control::delta_row;
use sim::scene::stream::episode_seed;
use sim::{Perturbation, Profile, TaskId};

/// Number of episodes per task, of which at least one must succeed.
const TRIES: u32 = 12;

fn subject(task: TaskId) -> EpisodeSpec {
    let perturbation = Composition::from(Perturbation::None);
    EpisodeSpec { task, perturbation, strength: Strength::FULL, profile: Profile::Strict }
}

fn record(task: TaskId, episode_idx: u32, mode: ControlMode) -> Result<Recording, DemoError> {
    Recording::of_expert(subject(task), episode_seed(1000, task.name(), episode_idx), mode)
}

#[test]
fn demonstration_of_every_task_replays_to_its_fingerprint() {
    TaskId::ALL.par_iter().for_each(|&task| {
        let mode = task.task().morphology.default_control_mode();
        let found = (0..TRIES).find_map(|episode_idx| {
            let recording = record(task, episode_idx, mode).ok()?;
            recording.success_at_end().then_some((episode_idx, recording))
        });
        let Some((episode_idx, recording)) = found else { panic!("{}: no success", task.name()) };
        let (n_frames, action_dim) = (recording.n_frames(), mode.action_dim(task.task().morphology));
        assert!(
            (10..=task.task().max_steps as usize).contains(&n_frames),
            "{}: {n_frames} frames",
            task.name()
        );
        assert_eq!(recording.actions().len(), n_frames * action_dim);
        assert_eq!(recording.states().len(), n_frames * task.task().morphology.state_dim());
        let seed = episode_seed(1000, task.name(), episode_idx);
        let replayed = Recording::replay(subject(task), seed, mode, recording.actions()).unwrap();
        assert!(replayed.success_at_end(), "{}", task.name());
        assert_eq!(replayed.fingerprint(), recording.fingerprint(), "{}", task.name());
        assert_eq!(replayed.states(), recording.states(), "{}", task.name());
        let mut altered = recording.actions().to_vec();
        altered[action_dim + 2] += 0.01;
        let changed = Recording::replay(subject(task), seed, mode, &altered).unwrap();
        assert_ne!(changed.fingerprint(), recording.fingerprint(), "{}", task.name());
    });
}

#[test]
fn unsupported_control_mode_is_named_in_the_error() {
    let error_of = |task, mode| record(task, 0, mode).err().map(|error| error.to_string());
    let error = error_of(TaskId::RaiseCube, ControlMode::EePose).unwrap();
    assert!(error.contains("not in pd_ee_pose"), "{error}");
    assert!(error_of(TaskId::DualArmLiftTray, ControlMode::EeDeltaPose).is_some());
    assert_eq!(TaskId::DualArmLiftTray.task().morphology, Morphology::Bimanual);
}

#[test]
fn delta_row_expresses_or_clips_a_displacement() {
    let mut row = [0.0; 6];
    assert!(delta_row(&[0.05, -0.1, 0.0, 0.0, 0.02, -0.06].into(), &mut row));
    assert_eq!(row, [0.5, -1.0, 0.0, 0.0, -0.2, 0.6]);
    assert!(!delta_row(&[0.2, 0.01, 0.0, 0.0, 0.0, 0.05].into(), &mut row));
    assert_eq!(row, [1.0, 0.1, 0.0, 0.0, 0.0, -0.5]);
    // A rotation is scaled down by its norm.
    assert!(!delta_row(&[0.0, 0.0, 0.0, 0.12, 0.0, 0.16].into(), &mut row));
    assert_eq!(row.map(|x| (x * 1e4).round() / 1e4), [0.0, 0.0, 0.0, -0.6, 0.0, -0.8]);
}
