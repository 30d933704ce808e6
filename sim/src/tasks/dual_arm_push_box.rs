//! DualArmPushBox: two closed hands push a box to the goal (spec/tasks.md §3, task 21).

use core::f64::consts::FRAC_PI_6;

use ipc_types::Morphology;
use nalgebra::{Isometry3, Vector3};

use super::common::{BIMANUAL_TABLE_Z, ExternalCameras, bimanual, box_part, goal_marker, movable, region, rgb};
use crate::expert::{Move, both_arms, grasp};
use crate::predicate::Predicate;
use crate::profile::Profile;
use crate::scene::{AppearanceSpec, PartSpec, Primitive, Range, Scene, SceneSpec};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "DualArmPushBox-v1",
    category: Category::Reorientation,
    morphology: Morphology::Bimanual,
    max_steps: 130,
    demo_steps: 93.0,
    instruction: "use both hands to push the box to the target location",
    paraphrases: include_str!("paraphrases/dual_arm_push_box.txt"),
    nominal,
    success,
    expert,
};

const HALF: [f64; 3] = [0.08, 0.12, 0.04];
const RED: [f64; 3] = rgb([194, 19, 22]);
/// Both hands beside the box, pointing down.
const QPOS: [[f64; 7]; 2] =
    [[0.84, 0.154, -0.27, -2.496, 0.086, 2.642, -0.288], [2.307, 0.17, 0.273, -2.473, -0.096, 2.633, 1.875]];

fn nominal() -> SceneSpec {
    let pushed = movable(
        "box",
        vec![box_part(HALF, [0.0; 3], AppearanceSpec::plain([0.0, 0.5, 0.0]))],
        0,
        BIMANUAL_TABLE_Z,
    )
    .with_yaw(Range::symmetric(FRAC_PI_6));
    let [hx, hy, _] = HALF;
    let (patch, half_height) = (Primitive::Box { half: [hx, hy, 5e-4] }, 5e-4);
    let patch = goal_marker(1, vec![PartSpec::at(patch, [0.0, 0.0, half_height], AppearanceSpec::plain(RED))]);
    let regions = vec![
        region("box", Range::new(-0.2, 0.0), Range::symmetric(0.1)),
        region("goal", Range::fixed(-0.4), Range::fixed(0.0)).not_widened(),
    ];
    let cameras = ExternalCameras {
        external1: [[0.75, 0.0, 1.58], [-0.2, 0.0, 0.93]],
        external2: [[-0.75, 0.0, 1.33], [-0.2, 0.0, 0.93]],
    };
    bimanual(QPOS, 0.0, &cameras, regions, vec![pushed, patch], TASK.instruction)
}

/// The box's middle within 60 mm of the goal's.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    let [top, base] = ["box", "goal"].map(|name| scene.body_idx(name));
    vec![Predicate::On { top, base, xy_m: 0.06, rise_m: 0.0, rise_tolerance_m: f64::INFINITY }]
}

/// How far from the middle of the box's far side a hand may push, in m, at scale 1: the second for what is out of reach.
const APART: [f64; 3] = [0.06, 0.085, 0.11];
/// Leans of the hand that are tried, in rad.
const LEANS: [f64; 3] = [0.0, 0.3, 0.6];
/// Half the thickness of closed fingers along the way they close, in m.
const FINGERS: f64 = 0.012;
/// How far the fingers stay away from the box before they push, in m.
const AWAY: f64 = 0.02;
/// Height of the TCPs over the table, in m.
const LOW: f64 = 0.03;

fn expert(scene: &Scene) -> Vec<Move> {
    let pushed = scene.body("box");
    let middle = pushed.pose.translation.vector;
    let forward = scene.body("goal").pose.translation.vector - middle;
    let forward = Vector3::new(forward.x, forward.y, 0.0);
    let [hx, _, hz] = HALF.map(|half| half * pushed.scale);
    let (face, side) = (pushed.pose.rotation * Vector3::x(), pushed.pose.rotation * Vector3::y());
    let stations = |tcp: &Isometry3<f64>| {
        let away = grasp::translated(tcp, &(face * AWAY));
        [grasp::translated(&away, &(Vector3::z() * 0.12)), away, grasp::translated(tcp, &forward)]
    };
    let hands = [0, 1].map(|arm| {
        let closing = grasp::closest_closing(face, &grasp::start_closing(scene, arm));
        let candidates: Vec<_> = LEANS
            .iter()
            .flat_map(|lean| APART.map(|apart| (apart * [-1.0, 1.0][arm] * pushed.scale, *lean)))
            .map(|(apart, lean)| {
                let position = middle + face * (hx + FINGERS) + side * apart + Vector3::z() * (LOW - hz);
                grasp::tilted_toward_base(scene, arm, &grasp::pose(&position, &-Vector3::z(), &closing), lean)
            })
            .collect();
        stations(&grasp::first_reachable(scene, arm, &candidates, stations))
    });
    let both_at = |station: usize| both_arms(hands.map(|stations| stations[station]));
    vec![
        Move::close(&[0, 1], 4),
        Move::Joint(both_at(0)),
        Move::Straight(both_at(1)),
        Move::Straight(both_at(2)),
    ]
}
