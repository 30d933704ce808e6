//! What holds for every task of the suite, under every perturbation that applies to it.

use ipc_types::ControlMode;
use nalgebra::{Translation3, Vector3};
use rayon::prelude::*;
use sim::expert::Expert;
use sim::physics::World;
use sim::predicate::first_unmet;
use sim::scene::{Motion, Scene};
use sim::{Perturbation, Profile, TaskId, stream};

/// All cells that apply, for one profile.
fn cells() -> Vec<(TaskId, Perturbation)> {
    let applies = |task: TaskId, p: Perturbation| p.applies_to(&(task.task().nominal)()).is_ok();
    TaskId::ALL
        .iter()
        .flat_map(|task| Perturbation::ALL.iter().map(|p| (*task, *p)))
        .filter(|(task, p)| applies(*task, *p))
        .collect()
}

fn draw(task: TaskId, perturbation: Perturbation, episode_idx: u32) -> Scene {
    let spec = perturbation.apply((task.task().nominal)(), Profile::Strict);
    spec.draw(stream::episode_seed(0, task.name(), episode_idx))
}

fn succeeds(task: TaskId, scene: &Scene, world: &World) -> bool {
    first_unmet(&(task.task().success)(scene, Profile::Strict), world).is_none()
}

/// Steps a world through a whole episode; returns whether success held after any step.
fn roll_out(task: TaskId, scene: &Scene, mut act: impl FnMut(&World, &mut [f32])) -> bool {
    let mut world = World::build(scene, ControlMode::JointPos);
    let mut row = vec![0.0; ControlMode::JointPos.action_dim(task.task().morphology)];
    (0..task.task().max_steps).any(|_| {
        act(&world, &mut row);
        world.step(&row);
        assert!(world.is_finite());
        succeeds(task, scene, &world)
    })
}

/// Holds every arm where it is, grippers open.
fn hold(world: &World, row: &mut [f32]) {
    for (arm, row) in row.chunks_exact_mut(8).enumerate() {
        row[..7].copy_from_slice(&world.qpos(arm)[..7]);
        row[7] = 1.0;
    }
}

#[test]
fn success_is_false_at_reset_and_under_the_idle_policy() {
    cells().into_par_iter().for_each(|(task, perturbation)| {
        for episode_idx in 0..3 {
            let scene = draw(task, perturbation, episode_idx);
            assert!(
                !succeeds(task, &scene, &World::build(&scene, ControlMode::JointPos)),
                "{task:?} at reset"
            );
            assert!(!roll_out(task, &scene, hold), "{task:?} {perturbation:?} idle");
        }
    });
}

#[test]
fn success_is_false_when_everything_falls_off_the_table() {
    cells().into_par_iter().for_each(|(task, perturbation)| {
        let mut scene = draw(task, perturbation, 0);
        let success = (task.task().success)(&scene, Profile::Strict);
        for body in scene.bodies.iter_mut().filter(|body| body.motion == Motion::Dynamic) {
            body.pose = Translation3::from(Vector3::new(3.0, 0.0, 0.0)) * body.pose;
        }
        let mut world = World::build(&scene, ControlMode::JointPos);
        let mut row = vec![0.0; ControlMode::JointPos.action_dim(task.task().morphology)];
        for _ in 0..task.task().max_steps {
            hold(&world, &mut row);
            world.step(&row);
            assert!(first_unmet(&success, &world).is_some(), "{task:?} {perturbation:?}");
        }
    });
}

#[test]
fn the_expert_succeeds() {
    let n_episodes = 8_u32;
    cells().into_par_iter().for_each(|(task, perturbation)| {
        let successes = (0..n_episodes)
            .filter(|episode_idx| {
                let scene = draw(task, perturbation, *episode_idx);
                let Ok(mut expert) = Expert::new(&scene, &(task.task().expert)(&scene)) else { return false };
                roll_out(task, &scene, |world, row| expert.act(world, row))
            })
            .count();
        assert!(
            successes + 1 >= n_episodes as usize,
            "{task:?} {perturbation:?}: {successes} of {n_episodes}"
        );
    });
}

#[test]
fn scenes_are_valid_before_the_first_step() {
    for (task, perturbation) in cells() {
        let scene = draw(task, perturbation, 1);
        let morphology = task.task().morphology;
        assert_eq!(scene.robots.len(), morphology.n_arms());
        let n_cameras = morphology.n_external_cameras() + morphology.n_hand_cameras();
        assert_eq!(scene.cameras.len(), n_cameras, "{task:?}");
        assert!(scene.instruction.len() <= ipc_types::layout::INSTRUCTION_BYTES);
        assert_eq!(scene, draw(task, perturbation, 1), "a draw is a function of its seed");
    }
}
