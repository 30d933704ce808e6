//! Where to take hold of a body. TCP frame: z approaches, y closes, x = y × z.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::robot::ik;
use crate::robot::kinematics::{self, Joints};
use crate::scene::{Body, Scene};

/// How far below a body's top the TCP grips, unless half the body is less, in m.
const DEPTH_M: f64 = 0.025;
/// Sides whose lengths differ by less than this fraction count as equal.
const EQUAL_SIDES: f64 = 0.01;

/// World pose of an arm's TCP at the start of the scene.
#[must_use]
pub fn start_tcp(scene: &Scene, arm: usize) -> Isometry3<f64> {
    let robot = &scene.robots[arm];
    robot.base * kinematics::tcp(&Joints::from(robot.qpos))
}

/// World direction along which an arm's gripper closes at the start of the scene.
#[must_use]
pub fn start_closing(scene: &Scene, arm: usize) -> Vector3<f64> {
    start_tcp(scene, arm).rotation * Vector3::y()
}

/// TCP pose at `position` that approaches and closes along these world directions; `closing` is made perpendicular.
///
/// # Panics
/// If the directions are parallel.
#[must_use]
pub fn pose(position: &Vector3<f64>, approach: &Vector3<f64>, closing: &Vector3<f64>) -> Isometry3<f64> {
    let z = approach.normalize();
    let y = (closing - z * closing.dot(&z))
        .try_normalize(1e-9)
        .expect("a gripper does not close along its approach");
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[y.cross(&z), y, z]));
    Isometry3::from_parts(Translation3::from(*position), UnitQuaternion::from_rotation_matrix(&rotation))
}

/// The benchmark's rule for a grasp from above (spec/tasks.md §0): of the two axes of the body's box that lie level, close
/// along the shorter, or if they are equal along the one nearer to `preferred`; grip `DEPTH_M` below the top. Of the two
/// ways round, the one nearer to `closing_now` is taken, to spare the wrist.
#[must_use]
pub fn top_down(body: &Body, preferred: &Vector3<f64>, closing_now: &Vector3<f64>) -> Isometry3<f64> {
    let down = -Vector3::z();
    let box_extent = body.aabb(&Isometry3::identity());
    let sides = box_extent.max - box_extent.min;
    let centre = body.pose * nalgebra::Point3::from((box_extent.max + box_extent.min) / 2.0);
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| body.pose.rotation * axis);
    let upright = (0..3).max_by(|a, b| axes[*a].z.abs().total_cmp(&axes[*b].z.abs())).unwrap_or(2);
    let [a, b] = [(upright + 1) % 3, (upright + 2) % 3];
    let equal = (sides[a] - sides[b]).abs() < EQUAL_SIDES * sides[a].max(sides[b]);
    let a_is_better = if equal {
        axes[a].dot(preferred).abs() >= axes[b].dot(preferred).abs()
    } else {
        sides[a] < sides[b]
    };
    let closing = closest_closing(if a_is_better { axes[a] } else { axes[b] }, closing_now);
    let half = sides[upright] / 2.0;
    let position = centre.coords + down * (DEPTH_M.min(half) - half);
    pose(&position, &down, &closing)
}

/// The TCP pose leant back towards the arm's base by an angle, about the closing direction, so that the pads stay flat on
/// what they grip. It reaches farther: the wrist need not stand over the TCP.
#[must_use]
pub fn tilted_toward_base(scene: &Scene, arm: usize, tcp: &Isometry3<f64>, angle_rad: f64) -> Isometry3<f64> {
    let to_base = scene.robots[arm].base.translation.vector - tcp.translation.vector;
    let side = if (tcp.rotation * Vector3::x()).dot(&to_base) < 0.0 { 1.0 } else { -1.0 };
    tcp * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), side * angle_rad)
}

/// The first grasp all of whose stations the arm can come to from its start; the first of all if there is none.
///
/// # Panics
/// If there is no candidate.
#[must_use]
pub fn first_reachable<const N: usize>(
    scene: &Scene,
    arm: usize,
    candidates: &[Isometry3<f64>],
    stations: impl Fn(&Isometry3<f64>) -> [Isometry3<f64>; N],
) -> Isometry3<f64> {
    let robot = &scene.robots[arm];
    let within_reach = |tcp: &Isometry3<f64>| {
        let mut joints = Some(Joints::from(robot.qpos));
        for station in stations(tcp) {
            joints = joints.and_then(|from| ik::iterate(&(robot.base.inverse() * station), &from));
        }
        joints.is_some()
    };
    *candidates.iter().find(|tcp| within_reach(tcp)).unwrap_or(&candidates[0])
}

/// A gripper closes the same along a direction and against it: the way round that is nearer to `closing_now`.
#[must_use]
pub fn closest_closing(closing: Vector3<f64>, closing_now: &Vector3<f64>) -> Vector3<f64> {
    if closing.dot(closing_now) < 0.0 { -closing } else { closing }
}

/// The TCP pose backed off along its approach, by `distance_m`.
#[must_use]
pub fn retreated(tcp: &Isometry3<f64>, distance_m: f64) -> Isometry3<f64> {
    tcp * Translation3::new(0.0, 0.0, -distance_m)
}

/// The TCP pose moved by a world vector, in m.
#[must_use]
pub fn translated(tcp: &Isometry3<f64>, by: &Vector3<f64>) -> Isometry3<f64> {
    Translation3::from(*by) * tcp
}
