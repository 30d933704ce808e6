//! Screw motions of an arm's TCP, integrated through the Jacobian as in the original's planner.

use nalgebra::{Isometry3, Matrix3, SVector, Vector3};

use scene::robot::kinematics::{Jacobian, Joints, tcp, tcp_and_jacobian};
use scene::robot::panda::{LOWER, N_JOINTS, UPPER};

/// Length in joint space of each step but the last, in rad.
const STEP_RAD: f64 = 0.1;
/// Maximum number of steps. The joint limits allow no path in one direction that is longer.
const MAX_STEPS: usize = 400;
/// Angle below which a rotation is left out, in rad.
const MIN_ANGLE_RAD: f64 = 0.005_477;
/// Distance from half a turn at which the axis of a rotation is undefined, in rad.
const HALF_TURN_TOLERANCE_RAD: f64 = 0.003_2;
/// Length of the twist below which there is no path.
const MIN_TWIST: f64 = 1e-4;
/// Tolerance of the joint limits, in rad.
const LIMIT_TOLERANCE_RAD: f64 = 1e-3;

/// Returns joint positions along the screw motion from `from` to a TCP pose in the frame of link 0, or `None`
/// if a joint limit or a singularity is in the way.
///
/// Each step follows the Jacobian at its start and is not corrected, so that the path ends up to a centimetre
/// away from `goal`. The original's planner does the same, and its demonstrations show it.
pub(crate) fn path(goal: &Isometry3<f64>, from: &Joints) -> Option<Vec<Joints>> {
    let twist = twist(&(goal * tcp(from).inverse()))?;
    let length = twist.norm();
    if length < MIN_TWIST {
        return None;
    }
    let mut path = vec![*from];
    let mut remaining = length;
    for _ in 0..MAX_STEPS {
        let q = path[path.len() - 1];
        let jacobian = spatial_jacobian(&q);
        let normal = (jacobian * jacobian.transpose()).cholesky()?;
        let per_twist = jacobian.transpose() * normal.solve(&(twist / length));
        let advance = STEP_RAD / per_twist.norm();
        let next = q + per_twist * advance.min(remaining);
        let within = |joint: usize| {
            (LOWER[joint] - LIMIT_TOLERANCE_RAD..=UPPER[joint] + LIMIT_TOLERANCE_RAD).contains(&next[joint])
        };
        if !(0..N_JOINTS).all(within) {
            return None;
        }
        path.push(next);
        remaining -= advance;
        if remaining <= 0.0 {
            return Some(path);
        }
    }
    None
}

/// Returns the twist (linear at the origin, then angular) that produces a displacement in unit time, or
/// `None` for half a turn.
fn twist(by: &Isometry3<f64>) -> Option<SVector<f64, 6>> {
    let rotation = by.rotation.scaled_axis();
    let angle = rotation.norm();
    let (linear, angular) = if angle < MIN_ANGLE_RAD {
        (by.translation.vector, Vector3::zeros())
    } else if core::f64::consts::PI - angle < HALF_TURN_TOLERANCE_RAD {
        return None;
    } else {
        // Inverse left Jacobian of SO(3); Barfoot, "State Estimation for Robotics" (2017), section 7.1.
        let cross = rotation.cross_matrix();
        let half = angle / 2.0;
        let weight = (1.0 - half * libm::cos(half) / libm::sin(half)) / (angle * angle);
        let inverse = Matrix3::identity() - cross * 0.5 + cross * cross * weight;
        (inverse * by.translation.vector, rotation)
    };
    Some(SVector::from_iterator(linear.iter().chain(angular.iter()).copied()))
}

/// Returns the Jacobian whose linear rows are the velocity of the point of the hand at the base's origin.
fn spatial_jacobian(q: &Joints) -> Jacobian {
    let (tcp, mut jacobian) = tcp_and_jacobian(q);
    for mut column in jacobian.column_iter_mut() {
        let angular = Vector3::new(column[3], column[4], column[5]);
        let moment = tcp.translation.vector.cross(&angular);
        column.fixed_rows_mut::<3>(0).axpy(1.0, &moment, 1.0);
    }
    jacobian
}
