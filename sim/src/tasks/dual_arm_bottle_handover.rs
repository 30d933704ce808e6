//! DualArmBottleHandover: one arm picks up a bottle and hands it to the other arm. See docs/benchmark.md,
//! "Tasks".

use ipc_types::Morphology;
use nalgebra::{Isometry3, Point3, Vector3};

use super::common::{BIMANUAL_TABLE_Z, DENSITY, ExternalCameras, bimanual, movable, props, region};
use crate::expert::{Move, both_arms, grasp};
use crate::predicate::Predicate;
use crate::profile::Profile;
use crate::scene::{BodySpec, Mass, Range, Scene, SceneSpec};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "DualArmPickBottle-v1",
    category: Category::Handover,
    morphology: Morphology::Bimanual,
    max_steps: 155,
    demo_steps: 130.7,
    instruction: "use both arms to pick up the bottle",
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
/// Centre of the bottle's base in its frame, in m. The origin is off-centre because the benchmark grasps the
/// bottle at this offset from its origin.
const FOOT: [f64; 3] = [-0.05, 0.02, -0.09];

fn nominal() -> SceneSpec {
    let bottle = BodySpec {
        visuals: props::bottle(FOOT),
        mass: Mass::Density(DENSITY / props::PRISM_OVERLAP),
        ..movable("bottle", props::bottle_parts(FOOT), 0, BIMANUAL_TABLE_Z)
    };
    let target = [-0.2, 0.0, 1.03];
    let cameras =
        ExternalCameras { external1: [[0.75, 0.0, 1.33], target], external2: [[-0.5, 0.0, 1.33], target] };
    let beside_first_arm = region("bottle", Range::new(0.2, 0.4), Range::new(-0.3, -0.1));
    bimanual(QPOS, 0.0, &cameras, vec![beside_first_arm], vec![bottle], TASK.instruction)
}

/// Requires the second arm to hold the bottle.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    vec![Predicate::GraspedByNearest { body: scene.body_idx("bottle"), arm: 1 }]
}

/// Height above the bottle's base at which each arm grasps it, in m at scale 1: one hand above the other.
const GRASPS_Z: [f64; 2] = [0.115, 0.08];
/// World position of the first arm's TCP at the handover, in m.
const HANDOVER: Vector3<f64> = Vector3::new(-0.333, 0.04, 1.5);

/// Candidate rotations of the first hand about the bottle in rad, outwards, for bottles that are out of reach
/// at 0.
const YAWS: [f64; 4] = [0.0, 0.15, 0.3, 0.45];

fn expert(scene: &Scene) -> Vec<Move> {
    let bottle = scene.body("bottle");
    let grasp_pose = |arm: usize, approach: &Vector3<f64>| {
        let height = Vector3::z() * GRASPS_Z[arm];
        let position = bottle.pose * Point3::from((Vector3::from(FOOT) + height) * bottle.scale.x);
        let across = Vector3::z().cross(approach);
        let closing = grasp::closest_closing(across, &grasp::start_closing(scene, arm));
        grasp::pose(&position.coords, approach, &closing)
    };
    let candidates = YAWS.map(|yaw| grasp_pose(0, &Vector3::new(libm::sin(yaw), libm::cos(yaw), 0.0)));
    let waypoints =
        |tcp: &Isometry3<f64>| [grasp::translated(&grasp::retreated(tcp, 0.1), &(Vector3::z() * 0.15)), *tcp];
    let selected = grasp::first_reachable(scene, 0, &candidates, waypoints);
    let [pre_grasp, at] = waypoints(&selected);
    let [first, second] = [grasp_pose(0, &Vector3::y()), grasp_pose(1, &-Vector3::y())];
    let carry = HANDOVER - first.translation.vector;
    let apart = |distance_m: f64| {
        both_arms([first, second].map(|tcp| grasp::retreated(&grasp::translated(&tcp, &carry), distance_m)))
    };
    vec![
        Move::straight(0, pre_grasp),
        Move::straight(0, at),
        Move::Hold { steps: 2 },
        Move::close(&[0], 4),
        Move::Joint(apart(0.12)),
        Move::Straight(apart(0.0)),
        Move::close(&[1], 5),
        Move::open(&[0], 5),
        Move::straight(1, grasp::retreated(&grasp::translated(&second, &carry), 0.16)),
    ]
}
