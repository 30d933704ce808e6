//! DualArmThreading: one arm holds up a ring on a tripod and the other threads a needle through it. See
//! docs/benchmark.md, "Tasks".

use core::f64::consts::FRAC_PI_6;

use ipc_types::Morphology;
use nalgebra::{Isometry3, Vector3};

use super::common::bimanual_plan::BimanualPlan;
use super::common::objects::ring_and_needle::{self, NEEDLE_LENGTH, RING_Z};
use super::common::{ExternalCameras, bimanual, region};
use crate::expert::{Move, grasp};
use crate::predicate::{Predicate, Region};
use crate::task::profile::{Profile, ProfileRules};
use crate::task::{Category, Task};
use scene::{Range, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "DualArmThreading-v1",
    category: Category::Insertion,
    morphology: Morphology::Bimanual,
    max_steps: 192,
    demo_steps: 165.0,
    instruction: "use both hands to thread the object through the target opening",
    lerobot_instruction: "Thread with dual arms",
    paraphrases: include_str!("paraphrases/dual_arm_threading.txt"),
    nominal,
    success,
    expert,
};

/// Initial joint positions in rad: both hands near their objects, the first pointing down and the second
/// along −y.
const QPOS: [[f64; 7]; 2] = [
    [1.873, 0.142, -0.409, -2.725, 0.202, 2.852, 2.057],
    [-1.094, -0.935, -2.296, -2.236, -2.214, 1.062, -1.205],
];

fn nominal(_profile: Profile) -> SceneSpec {
    let regions = vec![
        region("needle", Range::new(-0.35, -0.25), Range::symmetric(0.05)),
        region("tripod", Range::new(0.15, 0.25), Range::symmetric(0.05)),
    ];
    let tripod = ring_and_needle::tripod(1).with_yaw(Range::new(0.0, FRAC_PI_6)).with_origin_z(0.9);
    let bodies = vec![ring_and_needle::needle(0).with_origin_z(0.85), tripod];
    let cameras = ExternalCameras {
        external1: [[0.6, 0.0, 1.33], [-0.2, 0.0, 0.93]],
        external2: [[-0.5, 0.0, 1.53], [-0.2, 0.0, 1.13]],
    };
    bimanual(QPOS, 0.0, &cameras, regions, bodies, TASK.instruction)
}

/// Requires the needle's end to be within 50 mm of the hole's axis and at most 50 mm beyond the ring's plane,
/// or else in a half-ellipsoid before the plane. The released code projects the end onto the plane by its
/// absolute distance, which doubles the distance of an end before the plane instead of removing it.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let [body, tripod] = ["needle", "tripod"].map(|name| scene.body_idx(name));
    let region = Region::DomedCylinder {
        origin: [0.0, 0.0, RING_Z - profile.ring_error_m()],
        axis: [1.0, 0.0, 0.0],
        radius: 0.05,
        length: 0.05,
        dome: 0.025,
    };
    vec![Predicate::Inside { body, point: [NEEDLE_LENGTH, 0.0, 0.0], of: Some(tripod), region }]
}

/// Grasp position along the needle, near its centre of mass, in m.
const NEEDLE_GRASP: f64 = 0.045;
/// Grasp position on the pole in the tripod's frame, in m.
const POLE_GRASP: Vector3<f64> = Vector3::new(0.0, 0.0, 0.09);
/// World position at which the ring's centre is held, in m.
const RING_POSITION: Vector3<f64> = Vector3::new(-0.14, -0.011, 1.28);
/// Distance of the needle's end in front of the ring's plane before insertion, in m.
const STANDOFF: f64 = 0.05;
/// Distance of the needle's end beyond the ring's plane after insertion, in m.
const INSERTION_DEPTH: f64 = 0.02;

fn expert(scene: &Scene) -> Vec<Move> {
    let needle = scene.body("needle");
    let closing = grasp::start_closing(scene, 0);
    let position = needle.point([NEEDLE_GRASP, 0.0, 0.0]);
    let at = grasp::pose(&position.coords, &-Vector3::z(), &closing);
    // The hand rotates from above the needle to behind it while the needle keeps pointing along x.
    let threading = |beyond_m: f64| {
        let position = RING_POSITION + Vector3::x() * (beyond_m - (NEEDLE_LENGTH - NEEDLE_GRASP));
        grasp::pose(&position, &Vector3::y(), &-Vector3::z())
    };

    let tripod = scene.body("tripod").resting_pose();
    let held = Isometry3::from(RING_POSITION - Vector3::z() * RING_Z);
    let pole = tripod * grasp::pose(&POLE_GRASP, &-Vector3::y(), &Vector3::x());
    let up = held * tripod.inverse() * pole;
    let raised = grasp::retreated(&at, 0.1);
    BimanualPlan::new(scene)
        .screw_one(0, raised)
        .screw_one(0, at)
        .close(0, 10)
        .screw_one(0, raised)
        .screw_one(1, pole)
        .close(1, 10)
        .screw_one(0, threading(-STANDOFF))
        .screw_one(1, up)
        .screw_one(0, threading(INSERTION_DEPTH))
        .into_moves()
}
