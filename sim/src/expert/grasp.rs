//! Grasp poses. In the TCP frame, z is the approach axis, y the closing axis and x = y × z.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::robot::ik;
use scene::robot::kinematics::{self, Joints};
use scene::{Body, Scene};

/// Maximum depth of a top-down grasp below the top of the body, in m; at most half the height of the body.
const GRASP_DEPTH_M: f64 = 0.025;
/// Relative difference below which two side lengths count as equal.
const EQUAL_SIDES_TOLERANCE: f64 = 0.01;

/// Returns the world pose of an arm's TCP in the start state of the scene.
#[must_use]
pub fn start_tcp(scene: &Scene, arm: usize) -> Isometry3<f64> {
    let robot = &scene.robots[arm];
    robot.base * kinematics::tcp(&Joints::from(robot.qpos))
}

/// Returns the closing axis of an arm's gripper in the start state of the scene, in the world frame.
#[must_use]
pub fn start_closing(scene: &Scene, arm: usize) -> Vector3<f64> {
    start_tcp(scene, arm).rotation * Vector3::y()
}

/// Returns the TCP pose at `position` with the given approach and closing directions, all in the world frame.
/// `closing` is orthogonalised against `approach`.
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

/// Returns a top-down grasp of a resting body by the benchmark's rule. Of the two horizontal axes of the
/// body's bounding box, the gripper closes along the shorter one; if both are equal, along the one closer to
/// `preferred`. The TCP is `GRASP_DEPTH_M` below the top. The sign of the closing axis is the one closer to
/// `closing_now`, which minimises wrist rotation.
#[must_use]
pub fn top_down(body: &Body, preferred: &Vector3<f64>, closing_now: &Vector3<f64>) -> Isometry3<f64> {
    let down = -Vector3::z();
    let box_extent = body.aabb(&Isometry3::identity());
    let sides = box_extent.max - box_extent.min;
    let resting = body.resting_pose();
    let centre = resting * nalgebra::Point3::from((box_extent.max + box_extent.min) / 2.0);
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| resting.rotation * axis);
    let upright = (0..3).max_by(|a, b| axes[*a].z.abs().total_cmp(&axes[*b].z.abs())).unwrap_or(2);
    let [a, b] = [(upright + 1) % 3, (upright + 2) % 3];
    let equal = (sides[a] - sides[b]).abs() < EQUAL_SIDES_TOLERANCE * sides[a].max(sides[b]);
    let a_is_better = if equal {
        axes[a].dot(preferred).abs() >= axes[b].dot(preferred).abs()
    } else {
        sides[a] < sides[b]
    };
    let closing = closest_closing(if a_is_better { axes[a] } else { axes[b] }, closing_now);
    let half = sides[upright] / 2.0;
    let position = centre.coords + down * (GRASP_DEPTH_M.min(half) - half);
    pose(&position, &down, &closing)
}

/// Returns the grasp with its TCP at the origin of the body.
#[must_use]
pub fn at_origin(body: &Body, tcp: &Isometry3<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(body.pose.translation, tcp.rotation)
}

/// Tilts a TCP pose about its closing axis by an angle, so that the hand leans towards the arm's base while
/// the pads stay flat on the object. Such a pose extends the reach, because the wrist need not be above the
/// TCP.
#[must_use]
pub fn tilted_toward_base(scene: &Scene, arm: usize, tcp: &Isometry3<f64>, angle_rad: f64) -> Isometry3<f64> {
    let to_base = scene.robots[arm].base.translation.vector - tcp.translation.vector;
    let side = if (tcp.rotation * Vector3::x()).dot(&to_base) < 0.0 { 1.0 } else { -1.0 };
    tcp * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), side * angle_rad)
}

/// Returns the first candidate for which the arm can reach all `stations` in sequence from its start, or the
/// first candidate if there is none.
///
/// # Panics
/// If `candidates` is empty.
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

/// Returns `closing` or its negation, whichever is closer to `closing_now`; both describe the same grasp.
#[must_use]
pub fn closest_closing(closing: Vector3<f64>, closing_now: &Vector3<f64>) -> Vector3<f64> {
    if closing.dot(closing_now) < 0.0 { -closing } else { closing }
}

/// Returns the TCP pose moved back along its approach axis by `distance_m`.
#[must_use]
pub fn retreated(tcp: &Isometry3<f64>, distance_m: f64) -> Isometry3<f64> {
    tcp * Translation3::new(0.0, 0.0, -distance_m)
}

/// Returns the TCP pose translated by a vector in the world frame, in m.
#[must_use]
pub fn translated(tcp: &Isometry3<f64>, by: &Vector3<f64>) -> Isometry3<f64> {
    Translation3::from(*by) * tcp
}
