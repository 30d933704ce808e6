//! Helpers for the physics and expert tests.

use ipc_types::ControlMode;
use nalgebra::{Isometry3, Translation3};
use sim::expert::{Expert, Move};
use sim::perturb::{Composition, Strength};
use sim::physics::World;
use sim::scene::stream::episode_seed;
use sim::scene::{Body, Motion, Primitive, Scene};
use sim::{Perturbation, Profile, TaskId};

/// Samples the scene of one episode of the suite with seed 0.
pub(crate) fn draw(task: TaskId, perturbation: Perturbation, episode_idx: u32) -> Scene {
    let spec = Composition::from(perturbation).spec(task.task(), Profile::Strict, Strength::FULL);
    spec.draw(episode_seed(0, task.name(), episode_idx))
}

/// Returns a scene with the given bodies above an empty table, without an arm.
pub(crate) fn bodies_only(bodies: Vec<Body>) -> Scene {
    let mut scene = draw(TaskId::RaiseCube, Perturbation::None, 0);
    scene.robots.clear();
    scene.bodies = bodies;
    scene
}

/// Returns a box-shaped body at a position, in m.
pub(crate) fn brick(name: &'static str, motion: Motion, half: [f64; 3], position: [f64; 3]) -> Body {
    let mut body = draw(TaskId::RaiseCube, Perturbation::None, 0).bodies.remove(0);
    body.parts[0].shape = Primitive::Box { half };
    Body { name, motion, pose: Isometry3::from(Translation3::from(position)), ..body }
}

/// Builds the world of a scene without arms and executes some control steps.
pub(crate) fn after(scene: &Scene, steps: u32) -> World {
    let mut world = World::build(scene, ControlMode::JointPos);
    (0..steps).for_each(|_| world.step(&[]));
    world
}

/// Returns an action row of zeros for a scene.
pub(crate) fn zeros(scene: &Scene, mode: ControlMode) -> Vec<f32> {
    let per_arm = if mode == ControlMode::JointPos { 8 } else { 7 };
    vec![0.0; per_arm * scene.robots.len()]
}

/// Returns the action row that holds the arms at their current positions with open grippers.
pub(crate) fn hold_row(scene: &Scene, world: &World, mode: ControlMode) -> Vec<f32> {
    let mut row = zeros(scene, mode);
    let per_arm = row.len() / scene.robots.len();
    for (arm, part) in row.chunks_exact_mut(per_arm).enumerate() {
        match mode {
            ControlMode::EeDeltaPose => {}
            ControlMode::JointPos => part[..7].copy_from_slice(&world.qpos(arm)[..7]),
            ControlMode::EePose => {
                let in_root = scene.robots[arm].base.inverse() * world.tcp_pose(arm).cast::<f64>();
                // The intrinsic XYZ angles of R are the negated roll, pitch and yaw of its inverse.
                let (roll, pitch, yaw) = in_root.rotation.inverse().euler_angles();
                let p = in_root.translation.vector;
                part[..6].copy_from_slice(&[p.x, p.y, p.z, -roll, -pitch, -yaw].map(|x| x as f32));
            }
        }
        part[per_arm - 1] = 1.0;
    }
    row
}

/// Executes a plan to its end and for `after` more control steps, calling `each` after every step.
pub(crate) fn play(
    scene: &Scene,
    moves: &[Move],
    after: usize,
    mut each: impl FnMut(usize, &World),
) -> World {
    let mut world = World::build(scene, ControlMode::JointPos);
    let mut expert = Expert::new(scene, moves).expect("the plan is reachable");
    let mut row = zeros(scene, ControlMode::JointPos);
    for step in 1..=expert.n_steps() + after {
        expert.act(&world, &mut row);
        world.step(&row);
        each(step, &world);
    }
    world
}
