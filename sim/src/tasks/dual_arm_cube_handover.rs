//! DualArmCubeHandover: one arm picks up a cube and hands it to the other arm. See docs/benchmark.md,
//! "Tasks".

use ipc_types::Morphology;
use nalgebra::{Isometry3, Vector3};

use super::common::{self, BIMANUAL_TABLE_Z, BLUE, ExternalCameras, QPOS_B, bimanual, region};
use crate::expert::{Move, both_arms, first_feasible, grasp};
use crate::predicate::Predicate;
use crate::profile::Profile;
use crate::scene::{Range, Scene, SceneSpec};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "DualArmPickCube-v1",
    category: Category::Handover,
    morphology: Morphology::Bimanual,
    max_steps: 213,
    demo_steps: 201.1,
    instruction: "use both arms to pick up the cube",
    paraphrases: include_str!("paraphrases/dual_arm_cube_handover.txt"),
    nominal,
    success,
    expert,
};

/// Half-extent of the cube, in m.
const HALF: f64 = 0.02;

fn nominal(_profile: Profile) -> SceneSpec {
    let cube = common::cube("cube", HALF, BLUE, 0, BIMANUAL_TABLE_Z).with_origin_z(0.85);
    let cameras = ExternalCameras {
        external1: [[0.75, 0.0, 1.33], [-0.2, 0.0, 1.03]],
        external2: [[-0.5, 0.0, 1.58], [-0.2, 0.0, 1.13]],
    };
    let around_origin = region("cube", Range::symmetric(0.1), Range::symmetric(0.1));
    bimanual([QPOS_B; 2], 0.0, &cameras, vec![around_origin], vec![cube], TASK.instruction)
}

/// Requires the second arm to hold the cube.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    vec![Predicate::GraspedByNearest { body: scene.body_idx("cube"), arm: 1 }]
}

/// World position of the handover, in m.
const HANDOVER: Vector3<f64> = Vector3::new(-0.2, 0.0, 1.2);
/// Candidate lean angles of the hand, in rad.
const LEANS: [f64; 3] = [0.0, 0.3, 0.6];
/// Lean angles that are tried last, in rad.
const FAR_LEANS: [f64; 3] = [0.8, 1.0, 1.2];

fn expert(scene: &Scene) -> Vec<Move> {
    let closing = grasp::start_closing(scene, 0);
    let upright = [Vector3::x(), Vector3::y()]
        .map(|preferred| grasp::top_down(scene.body("cube"), &preferred, &closing));
    let leaning = |leans: &'static [f64]| {
        upright
            .iter()
            .flat_map(|tcp| leans.iter().map(|lean| grasp::tilted_toward_base(scene, 0, tcp, *lean)))
    };
    let signs = [0, 1].map(|arm| nearer_sign(scene, arm));
    let near: Vec<Isometry3<f64>> = leaning(&LEANS).collect();
    let first = grasp::first_reachable(scene, 0, &near, |tcp| waypoints(tcp, signs[0]));
    let others = leaning(&LEANS)
        .chain(leaning(&FAR_LEANS))
        .flat_map(|tcp| [signs[0], -signs[0]].map(|sign| (tcp, sign)));
    let grips = core::iter::once((first, signs[0])).chain(others);
    first_feasible(scene, TASK.max_steps, grips.map(|(tcp, sign)| handover(&tcp, [sign, signs[1]])))
}

/// Returns an arm's TCP pose at the handover; `sign` selects one of its two closing directions. The hands
/// face each other along y. The first closes along x and the second along z, so that their fingers do not
/// collide.
fn handover_pose(arm: usize, sign: f64) -> Isometry3<f64> {
    let approach = Vector3::y() * [1.0, -1.0][arm];
    grasp::pose(&HANDOVER, &approach, &([Vector3::x(), Vector3::z()][arm] * sign))
}

/// Returns the sign (1 or −1) of the closing direction at the handover that is nearer to the hand's initial
/// orientation.
fn nearer_sign(scene: &Scene, arm: usize) -> f64 {
    let start = grasp::start_tcp(scene, arm);
    let nearer = |sign: &f64| (handover_pose(arm, *sign).rotation.inverse() * start.rotation).angle();
    [1.0, -1.0].into_iter().min_by(|a, b| nearer(a).total_cmp(&nearer(b))).unwrap_or(1.0)
}

/// Returns the first arm's waypoints: above the cube, at the cube, raised, in front of the handover and at
/// the handover.
fn waypoints(tcp: &Isometry3<f64>, sign: f64) -> [Isometry3<f64>; 5] {
    let raised = grasp::translated(tcp, &(Vector3::z() * 0.15));
    let there = handover_pose(0, sign);
    [grasp::retreated(tcp, 0.1), *tcp, raised, grasp::retreated(&there, 0.06), there]
}

/// Plans to grasp the cube and hand it over, with the given closing directions of the two hands.
fn handover(tcp: &Isometry3<f64>, [sign, other_sign]: [f64; 2]) -> Vec<Move> {
    let [above, at, raised, before, there] = waypoints(tcp, sign);
    let other = handover_pose(1, other_sign);
    vec![
        Move::straight(0, above),
        Move::straight(0, at),
        Move::close(&[0], 10),
        Move::straight(0, raised),
        Move::Joint(both_arms([before, grasp::retreated(&other, 0.12)])),
        Move::Straight(both_arms([there, other])),
        Move::close(&[1], 10),
        Move::open(&[0], 10),
        Move::straight(0, grasp::retreated(&there, 0.1)),
    ]
}
