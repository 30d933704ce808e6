//! What the tests of physics and experts share.

use ipc_types::ControlMode;
use nalgebra::{Isometry3, Translation3};
use sim::expert::{Expert, Move};
use sim::perturb::{Composition, Strength};
use sim::physics::World;
use sim::scene::{Body, Motion, Primitive, Scene};
use sim::stream::episode_seed;
use sim::{Perturbation, Profile, TaskId};

/// The scene of one episode of the suite with seed 0.
pub(crate) fn draw(task: TaskId, perturbation: Perturbation, episode_idx: u32) -> Scene {
    let spec = Composition::from(perturbation).spec(task.task(), Profile::Strict, Strength::FULL);
    spec.draw(episode_seed(0, task.name(), episode_idx))
}

/// Bodies over an empty table, without an arm.
pub(crate) fn bodies_only(bodies: Vec<Body>) -> Scene {
    let mut scene = draw(TaskId::RaiseCube, Perturbation::None, 0);
    scene.robots.clear();
    scene.bodies = bodies;
    scene
}

/// A body of one box at a place, in m.
pub(crate) fn brick(name: &'static str, motion: Motion, half: [f64; 3], position: [f64; 3]) -> Body {
    let mut body = draw(TaskId::RaiseCube, Perturbation::None, 0).bodies.remove(0);
    body.parts[0].shape = Primitive::Box { half };
    Body { name, motion, pose: Isometry3::from(Translation3::from(position)), ..body }
}

/// The world of a scene without arms after some control steps.
pub(crate) fn after(scene: &Scene, steps: u32) -> World {
    let mut world = World::build(scene, ControlMode::JointPos);
    (0..steps).for_each(|_| world.step(&[]));
    world
}

/// A row of zeros for the world of a scene.
pub(crate) fn zeros(scene: &Scene, mode: ControlMode) -> Vec<f32> {
    let per_arm = if mode == ControlMode::JointPos { 8 } else { 7 };
    vec![0.0; per_arm * scene.robots.len()]
}

/// The row that asks the arms to stay where they are, grippers open.
pub(crate) fn hold_row(scene: &Scene, world: &World, mode: ControlMode) -> Vec<f32> {
    let mut row = zeros(scene, mode);
    let per_arm = row.len() / scene.robots.len();
    for (arm, part) in row.chunks_exact_mut(per_arm).enumerate() {
        match mode {
            ControlMode::EeDeltaPose => {}
            ControlMode::JointPos => part[..7].copy_from_slice(&world.qpos(arm)[..7]),
            ControlMode::EePose => {
                let in_root = scene.robots[arm].base.inverse() * world.tcp_pose(arm).cast::<f64>();
                // Intrinsic XYZ angles of R are the negated roll, pitch and yaw of its inverse.
                let (roll, pitch, yaw) = in_root.rotation.inverse().euler_angles();
                let p = in_root.translation.vector;
                part[..6].copy_from_slice(&[p.x, p.y, p.z, -roll, -pitch, -yaw].map(|x| x as f32));
            }
        }
        part[per_arm - 1] = 1.0;
    }
    row
}

/// Plays a plan to its end and for `after` control steps more, calling `each` after every step.
pub(crate) fn play(
    scene: &Scene,
    moves: &[Move],
    after: usize,
    mut each: impl FnMut(usize, &World),
) -> World {
    let mut world = World::build(scene, ControlMode::JointPos);
    let mut expert = Expert::new(scene, moves).expect("the plan is within reach");
    let mut row = zeros(scene, ControlMode::JointPos);
    for step in 1..=expert.n_steps() + after {
        expert.act(&world, &mut row);
        world.step(&row);
        each(step, &world);
    }
    world
}
