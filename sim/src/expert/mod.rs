//! Scripted experts: an upper reference for policies, and the source of demonstrations.
//!
//! A task's expert is a short function that maps the sampled scene, including privileged state, to a sequence
//! of [`Move`]s. This module plans them: inverse kinematics, straight-line and joint-space paths, and their
//! time parametrisation. The whole plan is computed before the first control step and is executed open loop.

pub mod grasp;
mod moves;
mod plan;
mod screw;
mod spline;
mod timing;
mod topp;

pub use moves::{CONTROL_MODE, MotionPlanError, Move, TcpGoal, both_arms};

use crate::physics::World;
use scene::Scene;

/// Length of one arm's part of a `pd_joint_pos` action row.
const ROW_PER_ARM: usize = 8;

/// A planned sequence of `pd_joint_pos` action rows, and the position within it.
#[derive(Clone, Debug)]
pub struct Expert {
    rows: Vec<f32>,
    row_len: usize,
    next: usize,
}

impl Expert {
    /// Plans all moves, starting from the start state of the scene.
    ///
    /// # Errors
    /// If an arm cannot reach a pose; the error names the first one.
    pub fn new(scene: &Scene, moves: &[Move]) -> Result<Self, MotionPlanError> {
        let rows = plan::plan(scene, moves)?;
        Ok(Self { rows, row_len: ROW_PER_ARM * scene.robots.len(), next: 0 })
    }

    /// Returns the number of control steps of the plan.
    #[must_use]
    pub fn n_steps(&self) -> usize {
        self.rows.len() / self.row_len
    }

    /// Writes the next action row, `[8 · n_arms]` f32. After the end of the plan, the last row is repeated.
    ///
    /// # Panics
    /// If the length of `row` differs.
    pub fn act(&mut self, _world: &World, row: &mut [f32]) {
        let at = self.next.min(self.n_steps() - 1) * self.row_len;
        row.copy_from_slice(&self.rows[at..at + self.row_len]);
        self.next += 1;
    }
}

/// Returns the first of several alternative plans that is reachable and takes at most `max_steps` control
/// steps, or the first plan if there is none.
///
/// # Panics
/// If `plans` is empty.
#[must_use]
pub fn first_feasible(
    scene: &Scene,
    max_steps: u32,
    mut plans: impl Iterator<Item = Vec<Move>>,
) -> Vec<Move> {
    let is_feasible = |moves: &Vec<Move>| {
        Expert::new(scene, moves).is_ok_and(|expert| expert.n_steps() <= max_steps as usize)
    };
    let first = plans.next().expect("there is at least one plan");
    if is_feasible(&first) { first } else { plans.find(is_feasible).unwrap_or(first) }
}

/// Writes a joint-position action row that holds the arms at their current positions with open grippers.
pub(crate) fn write_hold_action(world: &World, row: &mut [f32]) {
    for (arm, row) in row.chunks_exact_mut(8).enumerate() {
        row[..7].copy_from_slice(&world.qpos(arm)[..7]);
        row[7] = 1.0;
    }
}
