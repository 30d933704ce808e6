//! DualArmPushBox: two closed grippers push a box to the goal. See docs/benchmark.md, "Tasks".

use core::f64::consts::FRAC_PI_6;

use ipc_types::Morphology;
use nalgebra::{Isometry3, Vector3};

use super::common::{
    BIMANUAL_TABLE_Z, ExternalCameras, bimanual, box_part, goal_marker, movable, region, rgb,
};
use crate::expert::{Move, both_arms, grasp};
use crate::predicate::Predicate;
use crate::task::profile::Profile;
use crate::task::{Category, Task};
use scene::{AppearanceSpec, Range, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "DualArmPushBox-v1",
    category: Category::Reorientation,
    morphology: Morphology::Bimanual,
    max_steps: 130,
    demo_steps: 93.0,
    instruction: "use both hands to push the box to the target location",
    lerobot_instruction: "Push the box with dual arms",
    paraphrases: include_str!("paraphrases/dual_arm_push_box.txt"),
    nominal,
    success,
    expert,
};

/// Half-extents of the box, in m.
const HALF: [f64; 3] = [0.08, 0.12, 0.04];
const RED: [f64; 3] = rgb([194, 19, 22]);
/// World z of the goal's mark in m: it floats 6 mm above the table, as in the benchmark.
const PATCH_Z: f64 = 0.831;
/// Initial joint positions in rad: both hands beside the box, pointing down.
const QPOS: [[f64; 7]; 2] =
    [[0.84, 0.154, -0.27, -2.496, 0.086, 2.642, -0.288], [2.307, 0.17, 0.273, -2.473, -0.096, 2.633, 1.875]];

fn nominal(_profile: Profile) -> SceneSpec {
    let target_box = movable(
        "box",
        vec![box_part(HALF, [0.0; 3], AppearanceSpec::plain([0.0, 0.5, 0.0]))],
        0,
        BIMANUAL_TABLE_Z,
    )
    .with_yaw(Range::symmetric(FRAC_PI_6));
    let [hx, hy, _] = HALF;
    let patch = box_part([hx, hy, 1e-4], [0.0; 3], AppearanceSpec::plain(RED));
    let patch = goal_marker(1, vec![patch]).with_origin_z(PATCH_Z);
    let regions = vec![
        region("box", Range::new(-0.2, 0.0), Range::symmetric(0.1)),
        region("goal", Range::fixed(-0.4), Range::fixed(0.0)).not_widened(),
    ];
    let cameras = ExternalCameras {
        external1: [[0.75, 0.0, 1.58], [-0.2, 0.0, 0.93]],
        external2: [[-0.75, 0.0, 1.33], [-0.2, 0.0, 0.93]],
    };
    bimanual(QPOS, 0.0, &cameras, regions, vec![target_box, patch], TASK.instruction)
}

/// Requires the box's centre to be within 60 mm of the goal's.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    let [top, base] = ["box", "goal"].map(|name| scene.body_idx(name));
    vec![Predicate::On { top, base, xy_m: 0.06, rise_m: 0.0, rise_tolerance_m: f64::INFINITY }]
}

/// Candidate distances of a hand from the middle of the box's rear side in m at scale 1; the later ones are
/// for boxes that are out of reach.
const LATERAL_OFFSETS: [f64; 3] = [0.06, 0.085, 0.11];
/// Candidate lean angles of the hand, in rad.
const LEANS: [f64; 3] = [0.0, 0.3, 0.6];
/// Half-thickness of closed fingers along their closing direction, in m.
const FINGER_HALF_THICKNESS: f64 = 0.012;
/// Distance of the fingers from the box before they push, in m.
const STANDOFF: f64 = 0.04;
/// Height of the TCPs above the table, in m.
const TCP_HEIGHT: f64 = 0.03;

fn expert(scene: &Scene) -> Vec<Move> {
    let target_box = scene.body("box");
    let centre = target_box.pose.translation.vector;
    let forward = scene.body("goal").pose.translation.vector - centre;
    let forward = Vector3::new(forward.x, forward.y, 0.0);
    let [hx, _, hz] = HALF.map(|half| half * target_box.scale.x);
    let (face, side) = (target_box.pose.rotation * Vector3::x(), target_box.pose.rotation * Vector3::y());
    let waypoints = |tcp: &Isometry3<f64>| {
        let away = grasp::translated(tcp, &(face * STANDOFF));
        [grasp::translated(&away, &(Vector3::z() * 0.2)), away, grasp::translated(tcp, &forward)]
    };
    let hands = [0, 1].map(|arm| {
        let closing = grasp::closest_closing(face, &grasp::start_closing(scene, arm));
        let candidates: Vec<_> = LEANS
            .iter()
            .flat_map(|lean| {
                LATERAL_OFFSETS.map(|offset| (offset * [-1.0, 1.0][arm] * target_box.scale.x, *lean))
            })
            .map(|(offset, lean)| {
                let position = centre
                    + face * (hx + FINGER_HALF_THICKNESS)
                    + side * offset
                    + Vector3::z() * (TCP_HEIGHT - hz);
                grasp::tilted_toward_base(scene, arm, &grasp::pose(&position, &-Vector3::z(), &closing), lean)
            })
            .collect();
        waypoints(&grasp::first_reachable(scene, arm, &candidates, waypoints))
    });
    let both_at = |waypoint: usize| both_arms(hands.map(|waypoints| waypoints[waypoint]));
    vec![
        Move::close(&[0, 1], 4),
        Move::Joint(both_at(0)),
        Move::Straight(both_at(1)),
        Move::Straight(both_at(2)),
    ]
}
