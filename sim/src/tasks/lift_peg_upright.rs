//! LiftPegUpright: grasp a lying peg by its end and stand it upright. See docs/benchmark.md, "Tasks".

use core::f64::consts::{FRAC_PI_2, PI};

use ipc_types::Morphology;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::common::{
    ExternalCameras, QPOS_D, QPOS_NOISE_RAD, SINGLE_TABLE_Z, movable, region, rgb, single_arm,
};
use crate::expert::{Move, first_feasible, grasp};
use crate::predicate::Predicate;
use crate::robot::control;
use crate::task::profile::{Profile, ProfileRules};
use crate::task::{Category, Task};
use scene::{AppearanceSpec, PartSpec, Primitive, Range, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "LiftPegUprightColosseumV2-v1",
    category: Category::Reorientation,
    morphology: Morphology::Single,
    max_steps: 224,
    demo_steps: 198.4,
    instruction: "lift the peg and stand it upright on the table",
    lerobot_instruction: "Lift the peg upright",
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
const GRASP_OFFSET: f64 = 0.1;
/// Height by which the peg is lifted, in m at scale 1. It swings down between the fingers.
const LIFT: f64 = 0.3;
/// Height by which the hanging peg is lowered onto the table, in m at scale 1.
const LOWER: f64 = 0.1;
/// Angle by which the hand leans while it lowers the peg, in rad.
const TILT: f64 = PI / 5.0;
/// Candidate angles by which the hand leans from the start, in rad: the far end of some pegs is out of reach
/// from straight above.
const START_LEANS: [f64; 4] = [0.0, 0.2, 0.4, 0.6];

fn expert(scene: &Scene) -> Vec<Move> {
    let (peg, closing) = (scene.body("peg"), grasp::start_closing(scene, 0));
    let tcp = grasp::top_down(peg, &closing, &closing);
    let half_turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI);
    let ends =
        [tcp, tcp * half_turn].map(|tcp| tcp * Translation3::new(GRASP_OFFSET * peg.scale.x, 0.0, 0.0));
    let options = START_LEANS.iter().flat_map(|lean| ends.map(|tcp| (tcp, *lean)));
    let grasps = options.map(|(tcp, lean)| grasp::tilted_toward_base(scene, 0, &tcp, lean));
    first_feasible(scene, TASK.max_steps, grasps.map(|tcp| stand_up(&tcp, peg.scale.x)))
}

/// Plans to grasp the peg by its end, lift it so that it swings down, and set it down on its other end.
fn stand_up(tcp: &Isometry3<f64>, scale: f64) -> Vec<Move> {
    let raised = |tcp: &Isometry3<f64>, by_m: f64| grasp::translated(tcp, &(Vector3::z() * by_m * scale));
    let lifted = raised(tcp, LIFT);
    // The friction of the fingers holds the peg at the same angle if their force grows with the torque of its
    // weight, with the fourth power of its scale. At scale 1, the fingers' target is the closed position.
    let target = HALF[1] * (scale - scale * scale * scale * scale);
    let command = control::gripper_command(target).max(-1.0) as f32;
    let leaning = lifted * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), TILT);
    vec![
        Move::Limit { per_joint: 0.75 },
        Move::straight(0, grasp::retreated(tcp, 0.05)),
        Move::straight(0, *tcp),
        Move::Grip { arms: vec![0], command, steps: 6 },
        Move::straight(0, lifted),
        Move::straight(0, leaning),
        Move::straight(0, raised(&leaning, -LOWER)),
        Move::open(&[0], 6),
    ]
}
