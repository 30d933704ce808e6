//! Scripted experts: the ceiling that policies are compared with, and the source of demonstrations.
//!
//! A task's expert is a short function of the drawn scene, privileged state included, that names [`Move`]s. Planning lives
//! here once: inverse kinematics, straight-line and joint-space motion, timing. A plan is made whole before the first step
//! and never looks at the world again.

pub mod grasp;
mod plan;
mod timing;

use ipc_types::ControlMode;
use nalgebra::Isometry3;
use thiserror::Error;

use crate::physics::World;
use crate::scene::Scene;

/// Numbers in one arm's part of a `pd_joint_pos` action row.
const ROW_PER_ARM: usize = 8;
/// How experts drive, with one arm and with two.
pub const CONTROL_MODE: ControlMode = ControlMode::JointPos;

/// Where a move takes an arm's TCP.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TcpGoal {
    /// Arm index.
    pub arm: usize,
    /// World pose of the TCP at the end of the move.
    pub tcp: Isometry3<f64>,
}

/// Both arms' TCPs at their poses.
#[must_use]
pub fn both_arms([first, second]: [Isometry3<f64>; 2]) -> Vec<TcpGoal> {
    vec![TcpGoal { arm: 0, tcp: first }, TcpGoal { arm: 1, tcp: second }]
}

/// One move of a plan. Arms that a move does not name hold still; grippers keep their last command.
#[derive(Clone, Debug, PartialEq)]
pub enum Move {
    /// TCPs go along straight lines, turning evenly; arms start and arrive together.
    Straight(Vec<TcpGoal>),
    /// The same from place to place without a stop; every place names the same arms.
    Waypoints(Vec<Vec<TcpGoal>>),
    /// Joints go the straight way to the nearest solution; arms start and arrive together.
    Joint(Vec<TcpGoal>),
    /// Grippers take a new command, −1 (squeeze) to 1 (open), and the arms hold for some control steps.
    Grip {
        /// Arm indices.
        arms: Vec<usize>,
        /// Gripper entry of the action.
        command: f32,
        /// Control steps.
        steps: u32,
    },
    /// All hold for some control steps.
    Hold {
        /// Control steps.
        steps: u32,
    },
}

impl Move {
    /// One arm's TCP along a straight line.
    #[must_use]
    pub fn straight(arm: usize, tcp: Isometry3<f64>) -> Self {
        Self::Straight(vec![TcpGoal { arm, tcp }])
    }

    /// Closes grippers with full squeeze.
    #[must_use]
    pub fn close(arms: &[usize], steps: u32) -> Self {
        Self::Grip { arms: arms.to_vec(), command: -1.0, steps }
    }

    /// Opens grippers.
    #[must_use]
    pub fn open(arms: &[usize], steps: u32) -> Self {
        Self::Grip { arms: arms.to_vec(), command: 1.0, steps }
    }

    /// Word for messages.
    const fn name(&self) -> &'static str {
        match self {
            Self::Straight(_) => "straight",
            Self::Waypoints(_) => "through",
            Self::Joint(_) => "joint",
            Self::Grip { .. } => "grip",
            Self::Hold { .. } => "hold",
        }
    }
}

/// A plan that the arm cannot follow.
#[derive(Clone, Debug, Error, PartialEq)]
#[error(
    "move {move_idx} ({name}): arm {} has no joint positions for its TCP at ({:.3}, {:.3}, {:.3}) m, {percent:.0} % of the way",
    arm + 1, at[0], at[1], at[2]
)]
pub struct MotionPlanError {
    /// Index of the move.
    pub move_idx: usize,
    /// Kind of move.
    pub name: &'static str,
    /// Arm index.
    pub arm: usize,
    /// World position of the TCP that cannot be reached, in m.
    pub at: [f64; 3],
    /// How far along the move.
    pub percent: f64,
}

/// A plan in execution, as `pd_joint_pos` action rows.
#[derive(Clone, Debug)]
pub struct Expert {
    rows: Vec<f32>,
    row_len: usize,
    next: usize,
}

impl Expert {
    /// Plans all moves from the scene's start.
    ///
    /// # Errors
    /// The first pose that an arm cannot reach.
    pub fn new(scene: &Scene, moves: &[Move]) -> Result<Self, MotionPlanError> {
        let rows = plan::plan(scene, moves)?;
        Ok(Self { rows, row_len: ROW_PER_ARM * scene.robots.len(), next: 0 })
    }

    /// Control steps of the plan.
    #[must_use]
    pub fn n_steps(&self) -> usize {
        self.rows.len() / self.row_len
    }

    /// Writes the next action row, `[8 per arm]` f32; the last one again when the plan has ended.
    ///
    /// # Panics
    /// If `row` has another length.
    pub fn act(&mut self, _world: &World, row: &mut [f32]) {
        let at = self.next.min(self.n_steps() - 1) * self.row_len;
        row.copy_from_slice(&self.rows[at..at + self.row_len]);
        self.next += 1;
    }
}

/// Where the same thing can be done in several ways: the first plan that the arms can follow within an episode, or the first
/// of all if there is none.
///
/// # Panics
/// If there is no plan.
#[must_use]
pub fn first_feasible(
    scene: &Scene,
    max_steps: u32,
    mut plans: impl Iterator<Item = Vec<Move>>,
) -> Vec<Move> {
    let in_time = |moves: &Vec<Move>| {
        Expert::new(scene, moves).is_ok_and(|expert| expert.n_steps() <= max_steps as usize)
    };
    let first = plans.next().expect("there is at least one plan");
    if in_time(&first) { first } else { plans.find(in_time).unwrap_or(first) }
}

/// A joint-position row that keeps the arms where they are, grippers open.
pub(crate) fn write_hold_action(world: &World, row: &mut [f32]) {
    for (arm, row) in row.chunks_exact_mut(8).enumerate() {
        row[..7].copy_from_slice(&world.qpos(arm)[..7]);
        row[7] = 1.0;
    }
}
