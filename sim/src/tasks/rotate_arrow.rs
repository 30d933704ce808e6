//! RotateArrow: turn an arrow that lies on the table until it points the other way. See docs/benchmark.md,
//! "Tasks".

use ipc_types::Morphology;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use super::common::{ExternalCameras, QPOS_NOISE_RAD, SINGLE_TABLE_Z, box_part, movable, region, single_arm};
use crate::expert::{Move, first_feasible, grasp};
use crate::predicate::Predicate;
use crate::profile::{Profile, ProfileRules};
use crate::robot::panda::TIP_BEYOND_TCP;
use crate::scene::{
    AppearanceSpec, BodySpec, PartSpec, Range, Scene, SceneSpec, Texture, VisualShape, VisualSpec,
};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "RotateArrow-v1",
    category: Category::Reorientation,
    morphology: Morphology::Single,
    max_steps: 355,
    demo_steps: 328.9,
    instruction: "rotate the arrow lever to the target direction",
    paraphrases: include_str!("paraphrases/rotate_arrow.txt"),
    nominal,
    success,
    expert,
};

/// x of the arrow's tail, of the root of its head and of its tip, in m from its origin.
const TAIL_ROOT_TIP: [f64; 3] = [-0.073, 0.071, 0.172];
/// Half-width of the shaft and of the head, in m. Together with the root they reproduce the volumes of the
/// benchmark's mesh and of its convex hull.
const HALF_WIDTHS: [f64; 2] = [0.014, 0.030];
/// Half-thickness of the arrow, in m.
const HALF_THICKNESS: f64 = 0.0197 / 2.0;
/// Number of slices of equal length that approximate the head for collision.
const HEAD_SLICES: u32 = 4;
/// Initial joint positions, in rad.
const QPOS: [f64; 7] = [0.0, 0.0, -0.04, -2.21, 0.0, 2.28, 0.66];

fn nominal() -> SceneSpec {
    let ceramic =
        AppearanceSpec { specular: 0.6, ..AppearanceSpec::textured(Texture::Marble, [0.55, 0.75, 0.95]) };
    let ([tail, root, tip], [shaft, head]) = (TAIL_ROOT_TIP, HALF_WIDTHS);
    let right = [[tail, -shaft], [root, -shaft], [root, -head], [tip, 0.0]];
    let left = right[..3].iter().rev().map(|[x, y]| [*x, -y]);
    let outline = right.into_iter().chain(left).collect();
    let arrow_shape = VisualShape::Extrusion { outline, holes: Vec::new(), half_height: HALF_THICKNESS };
    let slab = |from: f64, to: f64, half_width: f64| -> PartSpec {
        box_part([(to - from) / 2.0, half_width, HALF_THICKNESS], [(from + to) / 2.0, 0.0, 0.0], ceramic)
    };
    let head_slices = (0..HEAD_SLICES).map(|i| {
        let x = |i: f64| root + (tip - root) * i / f64::from(HEAD_SLICES);
        let centre = f64::from(i) + 0.5;
        slab(x(f64::from(i)), x(f64::from(i + 1)), head * (1.0 - centre / f64::from(HEAD_SLICES)))
    });
    let parts = core::iter::once(slab(tail, root, shaft)).chain(head_slices).collect();
    let arrow = BodySpec {
        visuals: vec![VisualSpec::at(arrow_shape, [0.0; 3], ceramic)],
        ..movable("arrow", parts, 0, SINGLE_TABLE_Z).with_yaw(Range::symmetric(15.0_f64.to_radians()))
    };
    let target = [-0.3, -0.2, 0.0];
    let cameras =
        ExternalCameras { external1: [[0.2, 0.0, 0.4], target], external2: [[0.0, 0.3, 0.4], target] };
    let beside_base = region("arrow", Range::new(-0.4, -0.2), Range::new(-0.3, -0.1));
    single_arm(QPOS, QPOS_NOISE_RAD, &cameras, vec![beside_base], vec![arrow], TASK.instruction)
}

/// Requires the arrow to be turned to within 26° of the opposite direction.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let body = scene.body_idx("arrow");
    let start = scene.bodies[body].pose.rotation * Vector3::x();
    let (with, min_deg) =
        if profile.judges_absolute_yaw() { (Vector3::x(), 90.0_f64) } else { (start, 154.0) };
    let angle_rad = [min_deg.to_radians(), core::f64::consts::PI];
    vec![Predicate::Aligned { body, axis: [1.0, 0.0, 0.0], with: with.into(), angle_rad, either_way: false }]
}

/// Candidate grasp positions along the arrow, in m at scale 1. The first may be too near the robot's base.
const GRASPS_X: [f64; 6] = [-0.025, 0.0, 0.025, 0.05, 0.065, 0.09];
/// Position of the pivot along the arrow, in m at scale 1: near the middle, so that the arrow stays in place.
const PIVOT_X: f64 = 0.05;
/// Total rotation, in rad.
const TURN: f64 = 2.8;
/// Number of moves, each ending in a stop, into which the rotation is split.
const N_MOVES: u32 = 12;
/// Clearance of the fingertips above the table, in m.
const CLEARANCE: f64 = 0.002;

fn expert(scene: &Scene) -> Vec<Move> {
    let options = GRASPS_X.iter().flat_map(|grasp_x| [(*grasp_x, TURN), (*grasp_x, -TURN)]);
    first_feasible(scene, TASK.max_steps, options.map(|(grasp_x, turn)| turn_arrow(scene, grasp_x, turn)))
}

/// Plans to grasp the arrow at `grasp_x` along its shaft and turn it about its pivot by `turn` rad.
fn turn_arrow(scene: &Scene, grasp_x: f64, turn: f64) -> Vec<Move> {
    let arrow = scene.body("arrow");
    let on_axis = |x: f64| arrow.pose * Point3::new(x * arrow.scale.x, 0.0, 0.0);
    let closing = grasp::closest_closing(arrow.pose.rotation * Vector3::y(), &grasp::start_closing(scene, 0));
    let [x, y, _] = on_axis(grasp_x).coords.into();
    let position = Vector3::new(x, y, SINGLE_TABLE_Z + TIP_BEYOND_TCP + CLEARANCE);
    let tcp = grasp::pose(&position, &-Vector3::z(), &closing);
    let turned = |angle: f64| {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
        Isometry3::rotation_wrt_point(rotation, on_axis(PIVOT_X)) * tcp
    };
    let above = grasp::retreated(&tcp, 0.05);
    let mut moves = vec![Move::straight(0, above), Move::straight(0, tcp), Move::close(&[0], 6)];
    moves.extend((1..=N_MOVES).map(|i| Move::straight(0, turned(turn * f64::from(i) / f64::from(N_MOVES)))));
    moves
}
