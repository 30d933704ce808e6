//! DualArmBottleHandover: one arm picks up a bottle and hands it to the other arm. See docs/benchmark.md,
//! "Tasks".

use core::f64::consts::FRAC_PI_2;

use ipc_types::Morphology;
use nalgebra::{Isometry3, Vector3};

use super::common::kitchen::bottle::{self, BOTTLE_RADIUS};
use super::common::{ExternalCameras, bimanual, region};
use crate::expert::{Move, both_arms, first_feasible, grasp};
use crate::predicate::Predicate;
use crate::task::profile::Profile;
use crate::task::{Category, Task};
use scene::{Range, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "DualArmPickBottle-v1",
    category: Category::Handover,
    morphology: Morphology::Bimanual,
    max_steps: 155,
    demo_steps: 130.7,
    instruction: "use both arms to pick up the bottle",
    lerobot_instruction: "Pick up the bottle with dual arms",
    paraphrases: include_str!("paraphrases/dual_arm_bottle_handover.txt"),
    nominal,
    success,
    expert,
};

/// Initial joint positions in rad: the first hand in front of the bottle, the second at the handover
/// position, both level.
const QPOS: [[f64; 7]; 2] = [
    [-0.8511, 1.7568, 1.5550, -1.4205, -0.2424, 2.1531, -0.8935],
    [1.0996, -0.9656, 0.2030, -2.2706, -2.0752, 3.4606, -0.1640],
];

fn nominal(_profile: Profile) -> SceneSpec {
    let target = [-0.2, 0.0, 1.03];
    let cameras =
        ExternalCameras { external1: [[0.75, 0.0, 1.33], target], external2: [[-0.5, 0.0, 1.33], target] };
    let beside_first_arm = region("bottle", Range::new(0.2, 0.4), Range::new(-0.3, -0.1));
    bimanual(QPOS, 0.0, &cameras, vec![beside_first_arm], vec![bottle::bottle(0)], TASK.instruction)
}

/// Requires the second arm to hold the bottle.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    vec![Predicate::GraspedByNearest { body: scene.body_idx("bottle"), arm: 1 }]
}

/// y in the bottle's frame at which each arm grasps it, in m at scale 1: one hand above the other. The upper
/// grasps are for bottles that are out of reach farther down.
const GRASPS_Y: [[f64; 2]; 3] = [[0.03, -0.005], [0.12, 0.085], [0.19, 0.11]];
/// World position of the first arm's TCP at the handover, in m.
const HANDOVER: Vector3<f64> = Vector3::new(-0.333, 0.04, 1.5);

/// Candidate rotations of the first hand about the bottle in rad, outwards, for bottles that are out of reach
/// at 0 or too wide there.
const YAWS: [f64; 7] = [0.0, 0.15, 0.3, 0.45, 0.8, 1.2, FRAC_PI_2];
/// Half of the width that fits between open fingers, in m.
const MAX_HALF_WIDTH: f64 = 0.038;

fn expert(scene: &Scene) -> Vec<Move> {
    let bottle = scene.body("bottle");
    let grasp_pose = |arm: usize, y: f64, approach: &Vector3<f64>| {
        let across = Vector3::z().cross(approach);
        let closing = grasp::closest_closing(across, &grasp::start_closing(scene, arm));
        grasp::pose(&bottle.point([0.0, y, 0.0]).coords, approach, &closing)
    };
    // The cross-section of a stretched bottle is an ellipse along world x and y.
    let half_width = |yaw: &f64| {
        let width =
            BOTTLE_RADIUS * libm::hypot(bottle.scale.x * libm::cos(*yaw), bottle.scale.z * libm::sin(*yaw));
        width.max(MAX_HALF_WIDTH)
    };
    let mut yaws = YAWS;
    yaws.sort_by(|a, b| half_width(a).total_cmp(&half_width(b)));
    let waypoints =
        |tcp: &Isometry3<f64>| [grasp::translated(&grasp::retreated(tcp, 0.1), &(Vector3::z() * 0.15)), *tcp];
    let plans = GRASPS_Y.iter().flat_map(|[first_y, second_y]| {
        let [first, second] =
            [grasp_pose(0, *first_y, &Vector3::y()), grasp_pose(1, *second_y, &-Vector3::y())];
        yaws.map(|yaw| {
            let approach = Vector3::new(libm::sin(yaw), libm::cos(yaw), 0.0);
            hand_over(waypoints(&grasp_pose(0, *first_y, &approach)), [first, second])
        })
    });
    first_feasible(scene, TASK.max_steps, plans)
}

/// Plans to grasp the bottle through two waypoints and to bring it to the handover. There the hands have the
/// positions relative to each other that they have in `grasps`.
fn hand_over([pre_grasp, grasp]: [Isometry3<f64>; 2], grasps: [Isometry3<f64>; 2]) -> Vec<Move> {
    let carry = HANDOVER - grasps[0].translation.vector;
    let apart = |distance_m: f64| {
        both_arms(grasps.map(|tcp| grasp::retreated(&grasp::translated(&tcp, &carry), distance_m)))
    };
    vec![
        Move::straight(0, pre_grasp),
        Move::straight(0, grasp),
        Move::Hold { steps: 2 },
        Move::close(&[0], 4),
        Move::Joint(apart(0.1)),
        Move::Straight(apart(0.0)),
        Move::close(&[1], 5),
        Move::open(&[0], 5),
        Move::straight(1, grasp::retreated(&grasp::translated(&grasps[1], &carry), 0.14)),
    ]
}
