//! Controllers, which convert an arm's part of an action row into joint targets (docs/benchmark.md, "Robot
//! and control").

use ipc_types::ControlMode;
use nalgebra::{Isometry3, SMatrix, SVector, Translation3, UnitQuaternion, Vector3};

use super::ik;
use scene::robot::kinematics::{Joints, tcp_and_jacobian};
use scene::robot::panda::{FINGER_OPEN, N_JOINTS};

/// Translation of `pd_ee_delta_pose` for an action of 1, in m.
const DELTA_TRANSLATION_M: f64 = 0.1;
/// Rotation for an action of 1, in rad. The benchmark multiplies by the lower bound of its range, hence the
/// sign.
const DELTA_ROTATION_RAD: f64 = -0.1;
/// Damping of the damped-least-squares step of `pd_ee_delta_pose`.
const DELTA_DAMPING: f64 = 1e-4;
/// Finger target for a gripper command of −1, in m. It lies beyond the closed position so that the fingers
/// squeeze.
const FINGER_SQUEEZE: f64 = -0.01;

/// Gains of a joint's PD drive: torque (N·m) or force (N) = stiffness · error − damping · velocity, clamped
/// to ± `limit`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Proportional gain, per rad or m.
    pub stiffness: f64,
    /// Derivative gain, per rad/s or m/s.
    pub damping: f64,
    /// Maximum torque or force.
    pub limit: f64,
}

/// Drive of the fingers in every control mode.
pub const FINGER_DRIVE: Drive = Drive { stiffness: 1000.0, damping: 100.0, limit: 100.0 };

/// Returns the drive of the arm joints in a control mode.
#[must_use]
pub const fn arm_drive(mode: ControlMode) -> Drive {
    let stiffness = match mode {
        ControlMode::EeDeltaPose => 3000.0,
        ControlMode::JointPos | ControlMode::EePose => 1000.0,
    };
    Drive { stiffness, damping: 100.0, limit: 100.0 }
}

/// Target positions of an arm's drives until the next control step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Targets {
    /// Joints 1 to 7, in rad.
    pub joints: Joints,
    /// Both fingers, in m.
    pub finger: f64,
}

/// Converts an arm's part of an action row, `[7]` or `[8]` f32 (see [`ControlMode`]), into targets. `q` are
/// the measured joint positions. An unreachable absolute pose yields `q` itself, so that the arm holds its
/// position.
///
/// # Panics
/// If the row is shorter than the mode's.
#[must_use]
pub fn targets(mode: ControlMode, row: &[f32], q: &Joints) -> Targets {
    let value = |i: usize| f64::from(row[i]);
    let vector = |i: usize| Vector3::new(value(i), value(i + 1), value(i + 2));
    match mode {
        ControlMode::EeDeltaPose => {
            Targets { joints: q + delta_step(&vector(0), &vector(3), q), finger: finger_target(value(6)) }
        }
        ControlMode::JointPos => Targets {
            joints: Joints::from_fn(|joint, _| value(joint)),
            finger: finger_target(value(N_JOINTS)),
        },
        ControlMode::EePose => {
            let target = Isometry3::from_parts(Translation3::from(vector(0)), intrinsic_xyz(&vector(3)));
            Targets { joints: ik::iterate(&target, q).unwrap_or(*q), finger: finger_target(value(6)) }
        }
    }
}

/// Returns the finger target in m for a gripper command in [−1, 1].
fn finger_target(gripper: f64) -> f64 {
    let unit = (gripper.clamp(-1.0, 1.0) + 1.0) / 2.0;
    FINGER_SQUEEZE + (FINGER_OPEN - FINGER_SQUEEZE) * unit
}

/// Returns the gripper command that yields a finger target: the inverse of the mapping in [`targets`].
#[must_use]
pub fn gripper_command(finger_m: f64) -> f64 {
    2.0 * (finger_m - FINGER_SQUEEZE) / (FINGER_OPEN - FINGER_SQUEEZE) - 1.0
}

/// Returns the joint displacement of one damped-least-squares step from the measured positions, as in the
/// benchmark's batched back end: Δq = (JᵀJ + λI)⁻¹ Jᵀ δ. Translation and rotation vector are in [−1, 1] and
/// in the root frame. The result is not clamped to the joint limits.
fn delta_step(translation: &Vector3<f64>, rotation: &Vector3<f64>, q: &Joints) -> Joints {
    let linear = translation.map(|x| x.clamp(-1.0, 1.0)) * DELTA_TRANSLATION_M;
    let angular = rotation / rotation.norm().max(1.0) * DELTA_ROTATION_RAD;
    let delta = SVector::<f64, 6>::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z);
    let (_, jacobian) = tcp_and_jacobian(q);
    let normal = jacobian.transpose() * jacobian + SMatrix::<f64, 7, 7>::identity() * DELTA_DAMPING;
    let factor = normal.cholesky().expect("a damped normal matrix is positive definite");
    factor.solve(&(jacobian.transpose() * delta))
}

/// Writes the first six entries of the `pd_ee_delta_pose` row for a TCP displacement (m, rad) in the root
/// frame. Returns `true` if one row can express it; otherwise the row is clipped to the action range.
///
/// # Panics
/// If the length of `row` is not 6.
pub fn delta_row(displacement: &SVector<f64, 6>, row: &mut [f32]) -> bool {
    assert_eq!(row.len(), 6, "translation and rotation");
    let linear = displacement.fixed_rows::<3>(0) / DELTA_TRANSLATION_M;
    let angular = displacement.fixed_rows::<3>(3) / DELTA_ROTATION_RAD;
    let angle = angular.norm();
    for axis in 0..3 {
        row[axis] = linear[axis].clamp(-1.0, 1.0) as f32;
        row[3 + axis] = (angular[axis] / angle.max(1.0)) as f32;
    }
    linear.amax() <= 1.0 && angle <= 1.0
}

/// Returns the rotation of intrinsic XYZ Euler angles: R = Rx · Ry · Rz.
fn intrinsic_xyz(angles: &Vector3<f64>) -> UnitQuaternion<f64> {
    let about = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
    about(Vector3::x_axis(), angles.x)
        * about(Vector3::y_axis(), angles.y)
        * about(Vector3::z_axis(), angles.z)
}
