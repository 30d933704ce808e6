//! The action rows of an episode that a policy drives: the current chunk, and the next one on its way.
//!
//! Without latency a chunk is executed as soon as it is received. With a latency of L control steps, the
//! robot goes on for L steps after each query before the answer takes effect, whenever it is received:
//! first with rows of the current chunk beyond those to execute, then by holding its last target. So an
//! episode depends on the latency, but not on how long inference really takes.

use ipc_types::ControlMode;
use ipc_types::layout::{MAX_ACTION_DIM, MAX_HORIZON};

use crate::expert::write_hold_action;
use crate::physics::World;

type Rows = Box<[f32; MAX_HORIZON * MAX_ACTION_DIM]>;

/// A policy's action chunks, `[n_rows, action_dim]` each.
pub(crate) struct ChunkBuffer {
    mode: ControlMode,
    action_dim: usize,
    /// Rows of a chunk that are executed before the next query.
    execute: u32,
    /// Control steps between a query and its effect.
    latency_steps: u32,
    rows: Rows,
    /// Rows of the current chunk.
    n_rows: usize,
    /// Index of the next row.
    next: usize,
    /// Control steps until the queried chunk takes effect.
    delay_left: u32,
    /// Rows of the queried chunk, if it has been received before it takes effect.
    arriving: Option<usize>,
    /// Buffer of the next chunk to arrive; `None` without latency.
    spare: Option<Rows>,
    /// The last executed row; `None` before the first.
    last: Option<[f32; MAX_ACTION_DIM]>,
}

impl ChunkBuffer {
    pub(crate) fn new(mode: ControlMode, action_dim: usize, execute: u32, latency_steps: u32) -> Self {
        let rows = || Box::new([0.0; MAX_HORIZON * MAX_ACTION_DIM]);
        Self {
            mode,
            action_dim,
            execute,
            latency_steps,
            rows: rows(),
            n_rows: 0,
            next: 0,
            delay_left: 0,
            arriving: None,
            spare: (latency_steps > 0).then(rows),
            last: None,
        }
    }

    /// Returns the number of rows of a chunk that are executed before the next query.
    pub(crate) fn execute(&self) -> u32 {
        self.execute
    }

    /// Returns `true` if a row can be executed without another answer.
    pub(crate) fn has_row(&self) -> bool {
        self.delay_left > 0 || self.next < self.n_rows.min(self.execute as usize)
    }

    /// Returns `true` if an answer to a query after `steps_left` steps before the end would take effect.
    pub(crate) fn is_query_useful(&self, steps_left: u32) -> bool {
        steps_left > self.latency_steps
    }

    /// Goes on without another query until the end of the episode.
    pub(crate) fn coast(&mut self, steps_left: u32) {
        self.delay_left = steps_left;
    }

    /// Starts the latency of a query.
    pub(crate) fn on_query(&mut self) {
        self.delay_left = self.latency_steps;
    }

    /// Takes a received chunk, `[n_rows, action_dim]`.
    pub(crate) fn receive(&mut self, rows: &[f32], n_rows: usize) {
        // Without latency no other row is ever executed.
        let n_rows = if self.latency_steps == 0 { n_rows.min(self.execute as usize) } else { n_rows };
        let len = n_rows * self.action_dim;
        match &mut self.spare {
            Some(spare) if self.delay_left > 0 => {
                spare[..len].copy_from_slice(&rows[..len]);
                self.arriving = Some(n_rows);
            }
            _ => {
                self.rows[..len].copy_from_slice(&rows[..len]);
                (self.n_rows, self.next) = (n_rows, 0);
            }
        }
    }

    /// Writes the next row to execute.
    pub(crate) fn next_row(&mut self, world: &World, row: &mut [f32]) {
        if self.next < self.n_rows {
            row.copy_from_slice(&self.rows[self.next * self.action_dim..][..self.action_dim]);
            self.next += 1;
        } else {
            self.hold(world, row);
        }
        self.last.get_or_insert([0.0; MAX_ACTION_DIM])[..row.len()].copy_from_slice(row);
        if self.delay_left > 0 {
            self.delay_left -= 1;
            if self.delay_left == 0 {
                self.take_effect();
            }
        }
    }

    /// Makes the received chunk the current one. If it has not been received yet, the episode waits for it.
    fn take_effect(&mut self) {
        if let (Some(n_rows), Some(spare)) = (self.arriving.take(), &mut self.spare) {
            std::mem::swap(&mut self.rows, spare);
            (self.n_rows, self.next) = (n_rows, 0);
        }
    }

    /// Writes a row that holds the last target, or the present pose with open grippers before the first row.
    fn hold(&self, world: &World, row: &mut [f32]) {
        match (self.mode, &self.last) {
            // No displacement, and the gripper as it was.
            (ControlMode::EeDeltaPose, last) => {
                row.fill(0.0);
                row[self.action_dim - 1] = last.map_or(1.0, |last| last[self.action_dim - 1]);
            }
            (ControlMode::JointPos | ControlMode::EePose, Some(last)) => {
                row.copy_from_slice(&last[..row.len()]);
            }
            // Plans refuse latency together with absolute poses.
            (ControlMode::JointPos | ControlMode::EePose, None) => write_hold_action(world, row),
        }
    }
}
