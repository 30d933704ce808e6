//! The moves of which a plan consists, and the error for one that an arm cannot reach.

use ipc_types::ControlMode;
use nalgebra::{Isometry3, Vector3};
use thiserror::Error;

/// Control mode of all experts, single-arm and bimanual.
pub const CONTROL_MODE: ControlMode = ControlMode::JointPos;

/// Target pose of an arm's TCP at the end of a move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TcpGoal {
    /// Index of the arm.
    pub arm: usize,
    /// World pose of the TCP at the end of the move.
    pub tcp: Isometry3<f64>,
}

/// Returns the goals of both arms from their TCP poses in the world frame.
#[must_use]
pub fn both_arms([first, second]: [Isometry3<f64>; 2]) -> Vec<TcpGoal> {
    vec![TcpGoal { arm: 0, tcp: first }, TcpGoal { arm: 1, tcp: second }]
}

/// One move of a plan. Arms that are not part of a move hold their position; grippers keep their last
/// command.
#[derive(Clone, Debug, PartialEq)]
pub enum Move {
    /// Moves TCPs along straight lines with uniform rotation. All arms start and arrive together. A single
    /// arm moves along a screw instead, as the original's planner integrates it: it ends up to a
    /// centimetre away from its goal.
    Straight(Vec<TcpGoal>),
    /// Like `Straight`, for a single arm that holds a body.
    Carry {
        /// Pose of the body before it was grasped.
        from: Isometry3<f64>,
        /// Pose of the body at the end of the move.
        to: Isometry3<f64>,
    },
    /// Moves TCPs along straight lines through a sequence of waypoints without stopping. Every waypoint has
    /// the same arms.
    Waypoints(Vec<Vec<TcpGoal>>),
    /// Interpolates linearly in joint space to the nearest inverse-kinematics solution. All arms start and
    /// arrive together.
    Joint(Vec<TcpGoal>),
    /// Sets the gripper command, −1 (squeeze) to 1 (open), and holds the arms' positions for some control
    /// steps.
    Grip {
        /// Indices of the arms.
        arms: Vec<usize>,
        /// Gripper command of the action row.
        command: f32,
        /// Number of control steps.
        steps: u32,
    },
    /// Repeats the last `Straight`, `Carry` or `Correct` move with a goal that is displaced by the
    /// distance from the held body to its pose `to`.
    Correct {
        /// Pose of the body before it was grasped.
        from: Isometry3<f64>,
        /// Intended pose of the body.
        to: Isometry3<f64>,
    },
    /// Like `Straight`, for a single arm, relative to where its TCP is.
    Shift {
        /// Displacement in the world frame, in m.
        by: Vector3<f64>,
    },
    /// Sets the limits of all later moves.
    Limit {
        /// Maximum speed in rad/s and maximum acceleration in rad/s² of every joint.
        per_joint: f64,
    },
    /// Holds everything for some control steps.
    Hold {
        /// Number of control steps.
        steps: u32,
    },
}

impl Move {
    /// Moves one arm's TCP along a straight line.
    #[must_use]
    pub fn straight(arm: usize, tcp: Isometry3<f64>) -> Self {
        Self::Straight(vec![TcpGoal { arm, tcp }])
    }

    /// Moves one arm's TCP along an exact straight line, for targets that leave no room for the error of a
    /// screw motion.
    #[must_use]
    pub fn line(arm: usize, tcp: Isometry3<f64>) -> Self {
        Self::Waypoints(vec![vec![TcpGoal { arm, tcp }]])
    }

    /// Closes grippers with maximum force.
    #[must_use]
    pub fn close(arms: &[usize], steps: u32) -> Self {
        Self::Grip { arms: arms.to_vec(), command: -1.0, steps }
    }

    /// Closes the gripper of a single arm with a third less force, so that it stops when the fingers touch.
    #[must_use]
    pub fn close_gently(steps: u32) -> Self {
        Self::Grip { arms: vec![0], command: -0.6, steps }
    }

    /// Opens grippers fully.
    #[must_use]
    pub fn open(arms: &[usize], steps: u32) -> Self {
        Self::Grip { arms: arms.to_vec(), command: 1.0, steps }
    }

    /// Returns the name used in error messages.
    pub(crate) const fn name(&self) -> &'static str {
        match self {
            Self::Straight(_) => "straight",
            Self::Carry { .. } => "carry",
            Self::Correct { .. } => "correct",
            Self::Shift { .. } => "shift",
            Self::Limit { .. } => "limit",
            Self::Waypoints(_) => "waypoints",
            Self::Joint(_) => "joint",
            Self::Grip { .. } => "grip",
            Self::Hold { .. } => "hold",
        }
    }
}

/// Error for a move that the arm cannot reach.
#[derive(Clone, Debug, Error, PartialEq)]
#[error(
    "move {move_idx} ({name}): arm {} has no joint positions for its TCP at ({:.3}, {:.3}, {:.3}) m, {percent:.0} % of the way",
    arm + 1, at[0], at[1], at[2]
)]
pub struct MotionPlanError {
    /// Index of the move.
    pub move_idx: usize,
    /// Name of the kind of move.
    pub name: &'static str,
    /// Index of the arm.
    pub arm: usize,
    /// Unreachable position of the TCP in the world frame, in m.
    pub at: [f64; 3],
    /// Position of that pose along the move, in percent.
    pub percent: f64,
}
