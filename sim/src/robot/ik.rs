//! Inverse kinematics of an arm by damped least squares within joint limits.

use nalgebra::{Isometry3, SMatrix, SVector};

use super::kinematics::{Jacobian, Joints, displacement, tcp_and_jacobian};
use super::panda::{LOWER, N_JOINTS, UPPER};

/// Iterations of one descent.
const MAX_ITERATIONS: usize = 100;
/// Distance (m) and angle (rad) from the target at which a descent has arrived.
const TOLERANCE: [f64; 2] = [1e-5, 1e-4];
/// Damping at the target; far from it the step is shortened instead.
const DAMPING: f64 = 1e-6;
/// Longest step of any joint in one iteration, in rad.
const MAX_STEP: f64 = 0.2;
/// Other places of the joint space that [`solve`] starts from.
const N_RESTARTS: usize = 24;

/// The solution that damped least squares descends to from `from`; `None` if it does not arrive. `target` is the TCP's
/// pose in the frame of link 0.
#[must_use]
pub fn descend(target: &Isometry3<f64>, from: &Joints) -> Option<Joints> {
    let mut q = *from;
    for _ in 0..MAX_ITERATIONS {
        let (tcp, jacobian) = tcp_and_jacobian(&q);
        let error = displacement(&tcp, target);
        if error.fixed_rows::<3>(0).norm() < TOLERANCE[0] && error.fixed_rows::<3>(3).norm() < TOLERANCE[1] {
            return Some(q);
        }
        let step = step_within_limits(jacobian, &error, &q)?;
        let shorten = (MAX_STEP / step.amax()).min(1.0);
        q = clamped(&(q + step * shorten));
    }
    None
}

/// The damped-least-squares step; joints that stand at a limit and would be pushed beyond it are left to the others.
fn step_within_limits(mut jacobian: Jacobian, error: &SVector<f64, 6>, q: &Joints) -> Option<Joints> {
    loop {
        let normal = jacobian * jacobian.transpose() + SMatrix::<f64, 6, 6>::identity() * DAMPING;
        let step = jacobian.transpose() * normal.cholesky()?.solve(error);
        let blocked = |joint: usize| {
            (q[joint] <= LOWER[joint] && step[joint] < 0.0) || (q[joint] >= UPPER[joint] && step[joint] > 0.0)
        };
        let mut all_free = true;
        for joint in (0..N_JOINTS).filter(|joint| blocked(*joint)) {
            jacobian.column_mut(joint).fill(0.0);
            all_free = false;
        }
        if all_free {
            return Some(step);
        }
    }
}

/// The solution nearest to `near` (by the joint that must move most) among those found from it and from fixed other
/// starts; `None` if the target is out of reach.
#[must_use]
pub fn solve(target: &Isometry3<f64>, near: &Joints) -> Option<Joints> {
    let distance = |q: &Joints| (q - near).amax();
    let starts = core::iter::once(*near).chain((1..=N_RESTARTS).map(spread));
    starts.filter_map(|from| descend(target, &from)).min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// The joints moved into their limits.
#[must_use]
pub fn clamped(q: &Joints) -> Joints {
    Joints::from_fn(|joint, _| q[joint].clamp(LOWER[joint], UPPER[joint]))
}

/// Point `index` of a sequence that fills the joint space evenly: multiples of the powers of the inverse of the root of
/// x⁸ = x + 1 (Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018).
fn spread(index: usize) -> Joints {
    const ROOT: f64 = 1.096_981_557_798_56;
    let mut power = 1.0;
    let unit: [f64; N_JOINTS] = core::array::from_fn(|_| {
        power /= ROOT;
        (0.5 + power * index as f64).fract()
    });
    Joints::from_fn(|joint, _| LOWER[joint] + (UPPER[joint] - LOWER[joint]) * unit[joint])
}
