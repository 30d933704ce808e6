//! RotateArrow: turn an arrow that lies on the table until it points the other way. See docs/benchmark.md,
//! "Tasks".

use ipc_types::Morphology;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use super::common::objects::arrow::{SECTIONS, arrow};
use super::common::{ExternalCameras, QPOS_NOISE_RAD, SINGLE_TABLE_Z, region, single_arm};
use crate::expert::{Move, first_feasible, grasp};
use crate::predicate::Predicate;
use crate::task::profile::{Profile, ProfileRules};
use crate::task::{Category, Task};
use scene::robot::panda::TIP_BEYOND_TCP;
use scene::{Range, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "RotateArrow-v1",
    category: Category::Reorientation,
    morphology: Morphology::Single,
    max_steps: 355,
    demo_steps: 328.9,
    instruction: "rotate the arrow lever to the target direction",
    lerobot_instruction: "Rotate the arrow",
    paraphrases: include_str!("paraphrases/rotate_arrow.txt"),
    nominal,
    success,
    expert,
};

/// Initial joint positions, in rad.
const QPOS: [f64; 7] = [0.0, 0.0, -0.04, -2.21, 0.0, 2.28, 0.66];

fn nominal(_profile: Profile) -> SceneSpec {
    let target = [-0.3, -0.2, 0.0];
    let cameras =
        ExternalCameras { external1: [[0.2, 0.0, 0.4], target], external2: [[0.0, 0.3, 0.4], target] };
    let beside_base = region("arrow", Range::new(-0.4, -0.2), Range::new(-0.3, -0.1));
    single_arm(QPOS, QPOS_NOISE_RAD, &cameras, vec![beside_base], vec![arrow(0)], TASK.instruction)
}

/// Requires the arrow to be turned to within 26° (a cosine of 0.9) of the opposite direction.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let body = scene.body_idx("arrow");
    let start = scene.bodies[body].pose.rotation * Vector3::x();
    let (with, min_deg) =
        if profile.judges_absolute_yaw() { (Vector3::x(), 90.0_f64) } else { (start, 154.16) };
    let angle_rad = [min_deg.to_radians(), core::f64::consts::PI];
    vec![Predicate::Aligned { body, axis: [1.0, 0.0, 0.0], with: with.into(), angle_rad, either_way: false }]
}

/// One way to turn the arrow, with the hand straddling its shaft. Positions are in m along x at scale 1.
#[derive(Clone, Copy)]
struct Hold {
    /// Position of the hand.
    x: f64,
    /// Position about which the arrow turns.
    pivot_x: f64,
    /// `true` if the hand grips the shaft; otherwise one finger of the open hand pushes it.
    grips: bool,
}

/// Candidates in order of preference: the arrow is pushed near its tail, like the benchmark's, unless that is
/// too near the robot's base. A pushed arrow turns about a point beyond its centre of mass; one that is
/// gripped turns about its middle, so that it stays in place.
const HOLDS: [Hold; 6] = [
    Hold { x: -0.026, pivot_x: 0.15, grips: false },
    Hold { x: -0.045, pivot_x: 0.13, grips: false },
    Hold { x: -0.025, pivot_x: 0.05, grips: true },
    Hold { x: 0.0, pivot_x: 0.05, grips: true },
    Hold { x: 0.025, pivot_x: 0.05, grips: true },
    Hold { x: 0.05, pivot_x: 0.05, grips: true },
];
/// Total rotation, in rad.
const TURN: f64 = 2.95;
/// Number of moves, each ending in a stop, into which the rotation is split.
const N_MOVES: u32 = 13;
/// Half of the gap between the open fingers, in m.
const HALF_GAP: f64 = 0.04;
/// Clearance of the fingertips above the table, in m.
const CLEARANCE: f64 = 0.002;

fn expert(scene: &Scene) -> Vec<Move> {
    let across = scene.body("arrow").resting_pose().rotation * Vector3::y();
    let closing = grasp::closest_closing(across, &grasp::start_closing(scene, 0));
    let ways = [(TURN, closing), (TURN, -closing), (-TURN, closing), (-TURN, -closing)];
    let options = HOLDS.iter().flat_map(|hold| ways.map(|(turn, closing)| (*hold, turn, closing)));
    let plans = options.map(|(hold, turn, closing)| turn_arrow(scene, hold, turn, &closing));
    first_feasible(scene, TASK.max_steps, plans)
}

/// Plans to straddle the arrow's shaft and turn it by `turn` rad.
fn turn_arrow(scene: &Scene, hold: Hold, turn: f64, closing: &Vector3<f64>) -> Vec<Move> {
    let arrow = scene.body("arrow");
    let (pose, [_, half_width, ..]) = (arrow.resting_pose(), SECTIONS[0][0]);
    let tcp_at = |y: f64| {
        let across = pose.rotation * Vector3::y() * y;
        let [x, y, _] = (arrow.point([hold.x, 0.0, 0.0]) + across).coords.into();
        let position = Vector3::new(x, y, SINGLE_TABLE_Z + TIP_BEYOND_TCP + CLEARANCE);
        grasp::pose(&position, &-Vector3::z(), closing)
    };
    let straddling = tcp_at(0.0);
    // The tail moves to the right when the arrow turns to the left, and the finger on its left pushes.
    let touching = turn.signum() * (half_width * arrow.scale.y - HALF_GAP);
    let start = if hold.grips { straddling } else { tcp_at(touching) };
    let turned = |angle: f64| {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
        Isometry3::rotation_wrt_point(rotation, arrow.point([hold.pivot_x, 0.0, 0.0])) * start
    };
    let mut moves = vec![
        Move::Limit { per_joint: 0.75 },
        Move::line(0, grasp::retreated(&straddling, 0.05)),
        Move::line(0, straddling),
    ];
    moves.push(if hold.grips { Move::close(&[0], 6) } else { Move::line(0, start) });
    moves.extend((1..=N_MOVES).map(|i| Move::line(0, turned(turn * f64::from(i) / f64::from(N_MOVES)))));
    moves
}
