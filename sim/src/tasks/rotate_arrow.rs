//! RotateArrow: turn an arrow that lies on the table until it points the other way (spec/tasks.md §2, task 8).

use ipc_types::Morphology;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use super::common::{ExternalCameras, QPOS_NOISE_RAD, SINGLE_TABLE_Z, box_part, movable, region, single_arm};
use crate::expert::{Move, first_feasible, grasp};
use crate::predicate::Predicate;
use crate::profile::Profile;
use crate::profile::ProfileRules;
use crate::robot::panda::TIP_BEYOND_TCP;
use crate::scene::{BodySpec, VisualShape, AppearanceSpec, PartSpec, Range, Scene, SceneSpec, Texture, VisualSpec};
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

/// Where the arrow's tail, the root of its head and its tip lie along its x axis, in m from its origin.
const ALONG: [f64; 3] = [-0.073, 0.071, 0.172];
/// Half the width of its shaft and of its head, in m. With the root they give the volumes of the mesh and its hull.
const HALF_WIDTHS: [f64; 2] = [0.014, 0.030];
/// Half its thickness, in m.
const HALF_THICKNESS: f64 = 0.0197 / 2.0;
/// Slices of equal length that the head collides as.
const HEAD_SLICES: u32 = 4;
const QPOS: [f64; 7] = [0.0, 0.0, -0.04, -2.21, 0.0, 2.28, 0.66];

fn nominal() -> SceneSpec {
    let ceramic = AppearanceSpec { specular: 0.6, ..AppearanceSpec::textured(Texture::Marble, [0.55, 0.75, 0.95]) };
    let ([tail, root, tip], [shaft, head]) = (ALONG, HALF_WIDTHS);
    let right = [[tail, -shaft], [root, -shaft], [root, -head], [tip, 0.0]];
    let left = right[..3].iter().rev().map(|[x, y]| [*x, -y]);
    let outline = right.into_iter().chain(left).collect();
    let seen = VisualShape::Extrusion { outline, holes: Vec::new(), half_height: HALF_THICKNESS };
    let slab = |from: f64, to: f64, half_width: f64| -> PartSpec {
        box_part([(to - from) / 2.0, half_width, HALF_THICKNESS], [(from + to) / 2.0, 0.0, 0.0], ceramic)
    };
    let head_slices = (0..HEAD_SLICES).map(|i| {
        let x = |i: f64| root + (tip - root) * i / f64::from(HEAD_SLICES);
        let middle = f64::from(i) + 0.5;
        slab(x(f64::from(i)), x(f64::from(i + 1)), head * (1.0 - middle / f64::from(HEAD_SLICES)))
    });
    let parts = core::iter::once(slab(tail, root, shaft)).chain(head_slices).collect();
    let arrow = BodySpec {
        visuals: vec![VisualSpec::at(seen, [0.0; 3], ceramic)],
        ..movable("arrow", parts, 0, SINGLE_TABLE_Z).with_yaw(Range::symmetric(15.0_f64.to_radians()))
    };
    let target = [-0.3, -0.2, 0.0];
    let cameras = ExternalCameras { external1: [[0.2, 0.0, 0.4], target], external2: [[0.0, 0.3, 0.4], target] };
    let beside_base = region("arrow", Range::new(-0.4, -0.2), Range::new(-0.3, -0.1));
    single_arm(QPOS, QPOS_NOISE_RAD, &cameras, vec![beside_base], vec![arrow], TASK.instruction)
}

/// The arrow turned to within 26° of the opposite direction.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let body = scene.body_idx("arrow");
    let start = scene.bodies[body].pose.rotation * Vector3::x();
    let (with, least_deg) =
        if profile.judges_absolute_yaw() { (Vector3::x(), 90.0_f64) } else { (start, 154.0) };
    let angle_rad = [least_deg.to_radians(), core::f64::consts::PI];
    vec![Predicate::Aligned { body, axis: [1.0, 0.0, 0.0], with: with.into(), angle_rad, either_way: false }]
}

/// Places along it where it may be taken, in m at scale 1; the first may be too near the robot's base.
const GRIPS: [f64; 6] = [-0.025, 0.0, 0.025, 0.05, 0.065, 0.09];
/// The place about which it is turned, in m at scale 1: near its middle, so that it stays where it is.
const PIVOT: f64 = 0.05;
/// How far it is turned in all, in rad, and in how many moves, each with a stop.
const TURN: f64 = 2.8;
const N_MOVES: u32 = 12;
/// How far the finger tips stay above the table, in m.
const CLEARANCE: f64 = 0.002;

fn expert(scene: &Scene) -> Vec<Move> {
    let ways = GRIPS.iter().flat_map(|grip| [(*grip, TURN), (*grip, -TURN)]);
    first_feasible(scene, TASK.max_steps, ways.map(|(grip, turn)| turned_by(scene, grip, turn)))
}

/// Takes the arrow at a place along its shaft and turns it about its middle.
fn turned_by(scene: &Scene, grip: f64, turn: f64) -> Vec<Move> {
    let arrow = scene.body("arrow");
    let on_axis = |x: f64| arrow.pose * Point3::new(x * arrow.scale, 0.0, 0.0);
    let closing = grasp::closest_closing(arrow.pose.rotation * Vector3::y(), &grasp::start_closing(scene, 0));
    let [x, y, _] = on_axis(grip).coords.into();
    let place = Vector3::new(x, y, SINGLE_TABLE_Z + TIP_BEYOND_TCP + CLEARANCE);
    let tcp = grasp::pose(&place, &-Vector3::z(), &closing);
    let turned = |angle: f64| {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
        Isometry3::rotation_wrt_point(rotation, on_axis(PIVOT)) * tcp
    };
    let above = grasp::retreated(&tcp, 0.05);
    let mut moves = vec![Move::straight(0, above), Move::straight(0, tcp), Move::close(&[0], 6)];
    moves.extend((1..=N_MOVES).map(|i| Move::straight(0, turned(turn * f64::from(i) / f64::from(N_MOVES)))));
    moves
}
