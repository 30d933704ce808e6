//! DualArmDrawerPlace: one arm opens a drawer and the other puts a cube into it. See docs/benchmark.md,
//! "Tasks".

use ipc_types::Morphology;
use nalgebra::{Isometry3, Point3, Vector3};

use super::common::bimanual_plan::BimanualPlan;
use super::common::furniture::drawer_unit::{CAMERAS, CARCASS, DRAWERS, DrawerPull, bodies, placement_region};
use super::common::{self, BIMANUAL_TABLE_Z, BLUE, bimanual, region};
use crate::expert::{Move, grasp};
use crate::predicate::Predicate;
use crate::task::profile::Profile;
use crate::task::{Category, Task};
use scene::{BodySpec, Range, ScaledBy, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "DualArmDrawerPlace-v1",
    category: Category::Articulated,
    morphology: Morphology::Bimanual,
    max_steps: 202,
    demo_steps: 186.4,
    instruction: "open the drawer with one hand and place the object inside with the other hand",
    lerobot_instruction: "Place object in drawer with dual arms",
    paraphrases: include_str!("paraphrases/dual_arm_drawer_place.txt"),
    nominal,
    success,
    expert,
};

/// Half-extent of the cube, in m.
const HALF: f64 = 0.02;
/// Initial joint positions in rad: the first hand above the table, the second in front of the unit. The
/// second arm's last joint starts at its limit.
const QPOS: [[f64; 7]; 2] =
    [[1.326, -0.15, -0.305, -2.887, -0.115, 2.742, 0.345], [1.373, -0.569, -0.1, -2.768, 1.35, 1.358, 3.281]];
/// Drawer that the second arm opens.
const OPENED_DRAWER: &str = DRAWERS[1];

fn nominal(_profile: Profile) -> SceneSpec {
    let cube = BodySpec {
        scaled_by: ScaledBy::Nothing("the released code leaves it as it is"),
        ..common::cube("cube", HALF, BLUE, 1, BIMANUAL_TABLE_Z)
    };
    let cube_region = region("cube", Range::new(-0.2, -0.1), Range::new(-0.1415, -0.1405));
    let bodies = bodies().into_iter().chain([cube]).collect();
    bimanual(QPOS, 0.0, &CAMERAS, vec![placement_region(), cube_region], bodies, TASK.instruction)
}

/// Requires the cube to be above the table and within 0.25 m of the unit's centre. The released code takes
/// the norm over the distances in all parallel environments; neither profile does, since an episode must not
/// depend on its batch.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    let [cube, unit] = ["cube", CARCASS].map(|name| scene.body_idx(name));
    vec![
        Predicate::Above { body: cube, z_m: 0.9 },
        Predicate::On { top: cube, base: unit, xy_m: 0.25, rise_m: 0.0, rise_tolerance_m: f64::INFINITY },
    ]
}

/// Distance by which the drawer is pulled, in m.
const PULL_DISTANCE: f64 = 0.2;
/// Position at which the cube is released in the carcass's frame, in m: above the side of the open drawer
/// that is nearer to its arm.
const RELEASE: [f64; 3] = [-0.2, -0.08, 0.1];
/// Position farther out, in the same frame, at which the cube waits until the drawer is open, in m.
const WAITING: [f64; 3] = [-0.3, -0.3, 0.1];
/// Candidate lean angles of the hand at the bar in rad; a bar far from the arm is out of reach head-on.
const PULL_LEANS: [f64; 5] = [0.4, 0.6, 0.8, 0.2, 0.0];
/// Candidate lean angles of the hand above the drawer, in rad.
const LEANS: [f64; 5] = [0.6, 0.8, 1.0, 0.4, 0.2];

fn expert(scene: &Scene) -> Vec<Move> {
    let (cube, unit) = (scene.body("cube"), scene.body(CARCASS));
    let closing = grasp::start_closing(scene, 0);
    // Close perpendicular to the direction of the unit, which the ends of the hand would touch otherwise.
    let cube_grasp = grasp::top_down(cube, &Vector3::y(), &closing);
    let in_unit = |position: [f64; 3]| (unit.pose * Point3::from(position)).coords;
    // Close perpendicular to the direction of the arm's base, so that the hand can lean straight back.
    let to_base = scene.robots[0].base.translation.vector - in_unit(RELEASE);
    let across = grasp::closest_closing(Vector3::z().cross(&to_base), &closing);
    let straight = grasp::pose(&in_unit(RELEASE), &-Vector3::z(), &across);
    let candidates = LEANS.map(|lean| grasp::tilted_toward_base(scene, 0, &straight, lean));
    let waypoints = |release: &Isometry3<f64>| {
        let waiting = grasp::translated(release, &(in_unit(WAITING) - in_unit(RELEASE)));
        [grasp::retreated(&cube_grasp, 0.1), cube_grasp, waiting, *release]
    };
    let [above, at, waiting, release] = waypoints(&grasp::first_reachable(scene, 0, &candidates, waypoints));
    // The opposite of the initial closing direction, at which the last joint is at its limit.
    let closing = -grasp::start_closing(scene, 1);
    let drawer = scene.body(OPENED_DRAWER);
    let pull = DrawerPull::new(scene, 1, drawer, PULL_DISTANCE, &closing, PULL_LEANS);
    BimanualPlan::new(scene)
        .screw([above, pull.pre_grasp])
        .screw([at, pull.grasp])
        .close(0, 6)
        .close(1, 6)
        .screw_one(0, waiting)
        .screw_one(1, pull.open)
        .screw_one(0, release)
        .open(0, 6)
        .screw_one(1, pull.grasp)
        .into_moves()
}
