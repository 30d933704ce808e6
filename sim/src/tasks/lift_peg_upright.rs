//! LiftPegUpright: grasp a lying peg by its end and stand it upright. See docs/benchmark.md, "Tasks".

use core::f64::consts::FRAC_PI_2;

use ipc_types::Morphology;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use super::common::{
    ExternalCameras, QPOS_D, QPOS_NOISE_RAD, SINGLE_TABLE_Z, movable, region, rgb, single_arm,
};
use crate::expert::{Move, first_feasible, grasp};
use crate::predicate::Predicate;
use crate::profile::{Profile, ProfileRules};
use crate::robot::control;
use crate::scene::{AppearanceSpec, PartSpec, Primitive, Range, Scene, SceneSpec};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "LiftPegUprightColosseumV2-v1",
    category: Category::Reorientation,
    morphology: Morphology::Single,
    max_steps: 224,
    demo_steps: 198.4,
    instruction: "lift the peg and stand it upright on the table",
    paraphrases: include_str!("paraphrases/lift_peg_upright.txt"),
    nominal,
    success,
    expert,
};

/// Half-length and half-width of the peg, in m.
const HALF: [f64; 2] = [0.12, 0.025];

fn nominal(_profile: Profile) -> SceneSpec {
    let [half_length, half_width] = HALF;
    let half = |side: f64, color: [u8; 3]| {
        let shape = Primitive::Box { half: [half_length / 2.0, half_width, half_width] };
        let appearance = AppearanceSpec::plain(rgb(color));
        PartSpec::at(shape, [side * half_length / 2.0, 0.0, 0.0], appearance)
    };
    let peg = movable("peg", vec![half(-1.0, [176, 14, 14]), half(1.0, [12, 42, 160])], 0, SINGLE_TABLE_Z)
        .with_orientation(UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2));
    let target = [-0.1, 0.0, 0.1];
    let cameras =
        ExternalCameras { external1: [[0.3, 0.0, 0.6], target], external2: [[0.0, 0.3, 0.5], target] };
    let around_origin = region("peg", Range::symmetric(0.1), Range::symmetric(0.1));
    single_arm(QPOS_D, QPOS_NOISE_RAD, &cameras, vec![around_origin], vec![peg], TASK.instruction)
}

/// Largest deviation of an upright peg from the vertical, in rad.
const LEAN: f64 = 0.08;

/// Requires the peg to be upright, with its centre at half its length above the table.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let body = scene.body_idx("peg");
    let middle_z = HALF[0] * if profile.scales_thresholds() { scene.bodies[body].scale.x } else { 1.0 };
    let upright = if profile.judges_third_euler_angle() {
        Predicate::ThirdEulerAngle { body, angle_rad: [FRAC_PI_2 - LEAN, FRAC_PI_2 + LEAN] }
    } else {
        Predicate::Aligned {
            body,
            axis: [1.0, 0.0, 0.0],
            with: [0.0, 0.0, 1.0],
            angle_rad: [0.0, LEAN],
            either_way: true,
        }
    };
    vec![
        upright,
        Predicate::inside_box(
            body,
            [f64::NEG_INFINITY, f64::NEG_INFINITY, middle_z - 0.005],
            [f64::INFINITY, f64::INFINITY, middle_z + 0.005],
        ),
    ]
}

/// Distance of the grasp from the peg's centre, in m at scale 1.
const GRASP_OFFSET: f64 = 0.085;
/// Depth by which the fingers squeeze, in m at scale 1: little enough that the peg swings down between them
/// without slipping.
const SQUEEZE: f64 = 0.0075;
/// Angle by which the peg stops short of hanging vertically, in rad.
const LAG: f64 = 0.12;
/// Candidate lean angles of the hand, in rad: the far end of some pegs is out of reach from straight above.
const LEANS: [f64; 4] = [0.0, 0.2, 0.4, 0.6];

fn expert(scene: &Scene) -> Vec<Move> {
    first_feasible(scene, TASK.max_steps, LEANS.iter().map(|lean| stand_up(scene, *lean)))
}

/// Plans to grasp the peg with a hand that leans back by `lean` rad, let it swing down and place it on its
/// end.
fn stand_up(scene: &Scene, lean: f64) -> Vec<Move> {
    let peg = scene.body("peg");
    let [half_length, half_width] = HALF.map(|half| half * peg.scale.x);
    let closing = grasp::start_closing(scene, 0);
    // Grasp the end that is farther from the robot, so that the hand swings up and away from its base.
    let grasp_offset = GRASP_OFFSET * peg.scale.x;
    let upright =
        grasp::translated(&grasp::top_down(peg, &closing, &closing), &(Vector3::x() * grasp_offset));
    let tcp = grasp::tilted_toward_base(scene, 0, &upright, lean);
    let standing = |above_m: f64, angle: f64| -> Isometry3<f64> {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -angle);
        let centre = peg.pose.translation.vector;
        let position = Vector3::new(centre.x, centre.y, half_length + grasp_offset + above_m);
        Isometry3::from_parts(position.into(), turn * tcp.rotation)
    };
    // The torque of the peg's weight grows with the fourth power of its scale.
    let squeeze = SQUEEZE * (peg.scale.x * peg.scale.x) * (peg.scale.x * peg.scale.x);
    let command = control::gripper_command(half_width - squeeze) as f32;
    vec![
        Move::straight(0, grasp::retreated(&tcp, 0.05)),
        Move::straight(0, tcp),
        Move::Grip { arms: vec![0], command, steps: 6 },
        Move::straight(0, standing(0.06, 0.0)),
        Move::straight(0, standing(0.06, LAG)),
        Move::straight(0, standing(0.001, LAG)),
        Move::open(&[0], 6),
        Move::straight(0, grasp::retreated(&standing(0.001, LAG), 0.08)),
    ]
}
