//! DualArmDrawerPlace: one arm opens a drawer, the other puts a cube into it (spec/tasks.md §3, task 25).

use ipc_types::Morphology;
use nalgebra::{Isometry3, Point3, Vector3};

use super::common::drawer_unit::{CARCASS, DRAWERS, CAMERAS, Pull, bodies, place};
use super::common::{self, BIMANUAL_TABLE_Z, BLUE, bimanual, region};
use crate::expert::{Move, both_arms, grasp};
use crate::predicate::Predicate;
use crate::profile::Profile;
use crate::scene::{BodySpec, Range, ScaledBy, Scene, SceneSpec};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "DualArmDrawerPlace-v1",
    category: Category::Articulated,
    morphology: Morphology::Bimanual,
    max_steps: 202,
    demo_steps: 186.4,
    instruction: "open the drawer with one hand and place the object inside with the other hand",
    paraphrases: include_str!("paraphrases/dual_arm_drawer_place.txt"),
    nominal,
    success,
    expert,
};

const HALF: f64 = 0.02;
/// The first hand over the table, the second one before the chest; its last joint starts at its stop.
const QPOS: [[f64; 7]; 2] = [
    [1.326, -0.15, -0.305, -2.887, -0.115, 2.742, 0.345],
    [1.373, -0.569, -0.1, -2.768, 1.35, 1.358, 3.281],
];
/// The drawer that is opened.
const OPENED: &str = DRAWERS[1];

fn nominal() -> SceneSpec {
    let cube = BodySpec {
        scaled_by: ScaledBy::Nothing("the released code leaves it as it is"),
        ..common::cube("cube", HALF, BLUE, 1, BIMANUAL_TABLE_Z)
    };
    let beside = region("cube", Range::new(-0.2, -0.1), Range::new(-0.1415, -0.1405));
    let bodies = bodies().into_iter().chain([cube]).collect();
    bimanual(QPOS, 0.0, &CAMERAS, vec![place(), beside], bodies, TASK.instruction)
}

/// The cube above the table and within 0.25 m of the chest's middle. The released code takes the norm over the distances
/// in all envs at once; neither profile does, as an episode must not depend on its batch.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    let [cube, chest] = ["cube", CARCASS].map(|name| scene.body_idx(name));
    vec![
        Predicate::Above { body: cube, z_m: 0.9 },
        Predicate::On { top: cube, base: chest, xy_m: 0.25, rise_m: 0.0, rise_tolerance_m: f64::INFINITY },
    ]
}

/// How far the drawer is pulled, in m.
const PULL: f64 = 0.2;
/// Where the cube is let go and where it waits for the drawer to be open, in the carcass's frame, in m: over the side of
/// the open drawer that is nearer to its arm, and still farther out.
const INTO: [f64; 3] = [-0.2, -0.08, 0.1];
const WAITING: [f64; 3] = [-0.3, -0.3, 0.1];
/// Leans of the hand that are tried over the drawer, in rad.
const LEANS: [f64; 5] = [0.6, 0.8, 1.0, 0.4, 0.2];

fn expert(scene: &Scene) -> Vec<Move> {
    let (cube, chest) = (scene.body("cube"), scene.body(CARCASS));
    let closing = grasp::start_closing(scene, 0);
    // Closing across the way to the chest, which the hand would touch with its ends.
    let grip = grasp::top_down(cube, &Vector3::y(), &closing);
    let in_chest = |position: [f64; 3]| (chest.pose * Point3::from(position)).coords;
    // Closing across the way to the arm's base, so that the hand can lean straight back.
    let to_base = scene.robots[0].base.translation.vector - in_chest(INTO);
    let across = grasp::closest_closing(Vector3::z().cross(&to_base), &closing);
    let straight = grasp::pose(&in_chest(INTO), &-Vector3::z(), &across);
    let candidates = LEANS.map(|lean| grasp::tilted_toward_base(scene, 0, &straight, lean));
    let stations = |into: &Isometry3<f64>| {
        let waiting = grasp::translated(into, &(in_chest(WAITING) - in_chest(INTO)));
        [grasp::retreated(&grip, 0.1), grip, waiting, *into]
    };
    let [above, at, waiting, into] = stations(&grasp::first_reachable(scene, 0, &candidates, stations));
    // The other way round than at the start, where the last joint is at its stop.
    let pull = Pull::new(scene, 1, scene.body(OPENED), PULL, &-grasp::start_closing(scene, 1));
    vec![
        Move::Straight(both_arms([above, pull.before])),
        Move::straight(0, at),
        Move::close(&[0], 6),
        // Only now, where the benchmark takes hold with both at once: the hands would meet under the drawer.
        Move::Straight(both_arms([waiting, pull.at])),
        Move::close(&[1], 6),
        Move::straight(1, pull.open),
        Move::straight(0, into),
        Move::open(&[0], 6),
        Move::Straight(both_arms([grasp::retreated(&into, 0.12), pull.at])),
    ]
}
