//! Plans of two arms by the rules of the benchmark's bimanual planner. See docs/differences.md.

use nalgebra::{Isometry3, Matrix3, Quaternion, Translation3, UnitQuaternion, Vector3};

use crate::expert::{Move, TcpGoal, both_arms, grasp};
use scene::Scene;

/// Length of twist that the benchmark's planner advances in one step, in m and rad. It neglects shorter
/// motions.
const STEP: f64 = 0.01;
/// Maximum rotation between two waypoints on a screw, in rad.
const MAX_TURN: f64 = 0.15;

/// Returns the TCP pose at `position` in m with the orientation (w, x, y, z).
pub(crate) fn pose(position: [f64; 3], [w, x, y, z]: [f64; 4]) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    Isometry3::from_parts(Translation3::from(position), rotation)
}

/// Moves of two arms, and the TCP poses at which they end.
#[derive(Clone)]
pub(crate) struct BimanualPlan {
    tcps: [Isometry3<f64>; 2],
    moves: Vec<Move>,
}

impl BimanualPlan {
    /// Starts a plan at the start state of the scene.
    pub(crate) fn new(scene: &Scene) -> Self {
        Self { tcps: [0, 1].map(|arm| grasp::start_tcp(scene, arm)), moves: Vec::new() }
    }

    /// Returns the moves.
    pub(crate) fn into_moves(self) -> Vec<Move> {
        self.moves
    }

    /// Moves both arms in joint space, in which the benchmark's sampling planner finds no obstacle.
    pub(crate) fn joint(mut self, tcps: [Isometry3<f64>; 2]) -> Self {
        self.tcps = tcps;
        self.then(Move::Joint(both_arms(tcps)))
    }

    /// Moves both TCPs along straight lines on which they start and arrive together.
    pub(crate) fn meet(mut self, tcps: [Isometry3<f64>; 2]) -> Self {
        self.tcps = tcps;
        self.then(Move::Straight(both_arms(tcps)))
    }

    /// Moves one TCP along a screw while the other arm holds its position.
    pub(crate) fn screw_one(self, arm: usize, tcp: Isometry3<f64>) -> Self {
        let mut tcps = self.tcps;
        tcps[arm] = tcp;
        self.screw(tcps)
    }

    /// Moves both TCPs along screws. Both advance by the same length of twist, 1 m counting as much as 1 rad;
    /// when the arm with the shorter motion arrives, both stop, and the other one goes on alone.
    pub(crate) fn screw(mut self, tcps: [Isometry3<f64>; 2]) -> Self {
        let screws = [0, 1].map(|arm| Screw::between(&self.tcps[arm], &tcps[arm]));
        let [shorter, longer] = {
            let [a, b] = [screws[0].length, screws[1].length];
            [a.min(b), a.max(b)]
        };
        if shorter > STEP && longer - shorter > STEP {
            self.advance(&screws, 0.0, shorter);
            self.advance(&screws, shorter, longer);
        } else {
            self.advance(&screws, 0.0, longer);
        }
        self.tcps = tcps;
        self
    }

    /// Adds the motion along both screws between two lengths of twist.
    fn advance(&mut self, screws: &[Screw; 2], from: f64, to: f64) {
        let moving = |arm: &usize| screws[*arm].length > from.max(STEP / 10.0);
        let arms: Vec<usize> = [0, 1].into_iter().filter(moving).collect();
        let turn = arms.iter().map(|arm| screws[*arm].turn_rate()).fold(0.0, f64::max) * (to - from);
        let n_waypoints = libm::ceil(turn / MAX_TURN).max(1.0);
        let at = |waypoint: u32| {
            let length = from + (to - from) * f64::from(waypoint) / n_waypoints;
            arms.iter().map(|&arm| TcpGoal { arm, tcp: screws[arm].at(length) }).collect()
        };
        self.moves.push(Move::Waypoints((1..=n_waypoints as u32).map(at).collect()));
    }

    /// Closes a gripper with maximum force.
    pub(crate) fn close(self, arm: usize, steps: u32) -> Self {
        self.then(Move::close(&[arm], steps))
    }

    /// Opens a gripper fully.
    pub(crate) fn open(self, arm: usize, steps: u32) -> Self {
        self.then(Move::open(&[arm], steps))
    }

    /// Holds everything.
    pub(crate) fn hold(self, steps: u32) -> Self {
        self.then(Move::Hold { steps })
    }

    fn then(mut self, mv: Move) -> Self {
        self.moves.push(mv);
        self
    }
}

/// A motion with a constant twist in the moving frame.
struct Screw {
    start: Isometry3<f64>,
    linear: Vector3<f64>,
    angular: Vector3<f64>,
    /// Norm of the twist.
    length: f64,
}

impl Screw {
    fn between(start: &Isometry3<f64>, end: &Isometry3<f64>) -> Self {
        let by = start.inverse() * end;
        let angular = by.rotation.scaled_axis();
        let inverse = left_jacobian(&angular).try_inverse().expect("a rotation by less than a full turn");
        let linear = inverse * by.translation.vector;
        let length = libm::hypot(linear.norm(), angular.norm());
        Self { start: *start, linear, angular, length }
    }

    /// Returns the rotation per length of twist.
    fn turn_rate(&self) -> f64 {
        self.angular.norm() / self.length
    }

    /// Returns the pose at a length of twist, or the last one if the motion is shorter.
    fn at(&self, length: f64) -> Isometry3<f64> {
        let t = (length / self.length).min(1.0);
        let angular = self.angular * t;
        let translation = Translation3::from(left_jacobian(&angular) * self.linear * t);
        self.start * Isometry3::from_parts(translation, UnitQuaternion::from_scaled_axis(angular))
    }
}

/// Returns the left Jacobian of SO(3); Barfoot, "State Estimation for Robotics" (2017), section 7.1.
fn left_jacobian(rotation: &Vector3<f64>) -> Matrix3<f64> {
    let (angle, cross) = (rotation.norm(), rotation.cross_matrix());
    // The first terms of the power series; the next ones are below 1e-16.
    if angle < 1e-5 {
        return Matrix3::identity() + cross / 2.0;
    }
    let square = angle * angle;
    Matrix3::identity()
        + cross * ((1.0 - libm::cos(angle)) / square)
        + cross * cross * ((angle - libm::sin(angle)) / (square * angle))
}
