//! Inverse kinematics of an arm by damped least squares (DLS) within joint limits.

use nalgebra::{Isometry3, SMatrix, SVector};

use scene::robot::kinematics::{Jacobian, Joints, displacement, tcp_and_jacobian};
use scene::robot::panda::{LOWER, N_JOINTS, UPPER};

/// Maximum number of DLS iterations from one start.
const MAX_ITERATIONS: usize = 100;
/// Distance (m) and angle (rad) from the target at which the iteration has converged.
const TOLERANCE: [f64; 2] = [1e-5, 1e-4];
/// Constant damping factor. Far from the target, the step length is limited instead.
const DAMPING: f64 = 1e-6;
/// Maximum displacement of any joint in one iteration, in rad.
const MAX_STEP: f64 = 0.2;
/// Additional starts of [`solve`], spread over the joint space.
const N_RESTARTS: usize = 24;

/// Iterates damped least squares from the joint positions `from`. `target` is the TCP pose in the frame of
/// link 0. Returns `None` if the iteration does not converge.
#[must_use]
pub fn iterate(target: &Isometry3<f64>, from: &Joints) -> Option<Joints> {
    let mut q = *from;
    for _ in 0..MAX_ITERATIONS {
        let (tcp, jacobian) = tcp_and_jacobian(&q);
        let error = displacement(&tcp, target);
        if error.fixed_rows::<3>(0).norm() < TOLERANCE[0] && error.fixed_rows::<3>(3).norm() < TOLERANCE[1] {
            return Some(q);
        }
        let step = step_within_limits(jacobian, &error, &q)?;
        let scale = (MAX_STEP / step.amax()).min(1.0);
        q = clamped(&(q + step * scale));
    }
    None
}

/// Returns the DLS step. Joints at a limit that the step would exceed are excluded, and the step is
/// recomputed without them.
fn step_within_limits(mut jacobian: Jacobian, error: &SVector<f64, 6>, q: &Joints) -> Option<Joints> {
    loop {
        let normal = jacobian * jacobian.transpose() + SMatrix::<f64, 6, 6>::identity() * DAMPING;
        let step = jacobian.transpose() * normal.cholesky()?.solve(error);
        let blocked = |joint: usize| {
            (q[joint] <= LOWER[joint] && step[joint] < 0.0) || (q[joint] >= UPPER[joint] && step[joint] > 0.0)
        };
        let mut none_blocked = true;
        for joint in (0..N_JOINTS).filter(|joint| blocked(*joint)) {
            jacobian.column_mut(joint).fill(0.0);
            none_blocked = false;
        }
        if none_blocked {
            return Some(step);
        }
    }
}

/// Returns the solution nearest to `near` (in the maximum norm over joints) among those found from `near` and
/// from `N_RESTARTS` fixed starts, or `None` if the target is out of reach.
#[must_use]
pub fn solve(target: &Isometry3<f64>, near: &Joints) -> Option<Joints> {
    let distance = |q: &Joints| (q - near).amax();
    let starts = core::iter::once(*near).chain((1..=N_RESTARTS).map(quasirandom_start));
    starts.filter_map(|from| iterate(target, &from)).min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// Clamps joint positions to the joint limits.
#[must_use]
pub fn clamped(q: &Joints) -> Joints {
    Joints::from_fn(|joint, _| q[joint].clamp(LOWER[joint], UPPER[joint]))
}

/// Returns point `index` of a quasirandom sequence over the joint space, the R₇ sequence of Roberts, "The
/// Unreasonable Effectiveness of Quasirandom Sequences" (2018), which uses powers of the inverse of the root
/// of x⁸ = x + 1.
fn quasirandom_start(index: usize) -> Joints {
    const ROOT: f64 = 1.096_981_557_798_56;
    let mut power = 1.0;
    let unit: [f64; N_JOINTS] = core::array::from_fn(|_| {
        power /= ROOT;
        (0.5 + power * index as f64).fract()
    });
    Joints::from_fn(|joint, _| LOWER[joint] + (UPPER[joint] - LOWER[joint]) * unit[joint])
}
