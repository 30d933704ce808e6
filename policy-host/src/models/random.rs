//! The random policy. Each value depends only on (episode, control step, action entry), not on how rows are
//! chunked.

use ipc_types::{ControlMode, ObservationView};

use super::rows::fill_rows;
use crate::generated::{SPLITMIX_GAMMA, splitmix64, unit};
use crate::policy::{ActionChunk, Policy, PolicyError};

/// Maximum distance between a commanded and the measured joint position.
const MAX_JOINT_OFFSET_RAD: f32 = 0.05;

/// Draws tool motions uniformly from [−1, 1], joint positions uniformly within 0.05 rad of the measured ones,
/// and gripper commands uniformly from [−1, 1].
#[derive(Clone, Copy, Debug)]
pub struct RandomPolicy;

impl Policy for RandomPolicy {
    fn act(
        &mut self,
        observation: &ObservationView<'_>,
        answer: &mut [ActionChunk],
    ) -> Result<(), PolicyError> {
        let control_mode = observation.control_mode();
        let arm_dim = control_mode.action_dim(observation.morphology()) / observation.morphology().n_arms();
        fill_rows("random", observation, answer, |record, step, row| {
            for (entry, x) in row.iter_mut().enumerate() {
                let drawn = draw(record.policy_seed, step, entry);
                let is_gripper = entry % arm_dim == arm_dim - 1;
                match control_mode {
                    ControlMode::JointPos if !is_gripper => *x += MAX_JOINT_OFFSET_RAD * drawn,
                    _ => *x = drawn,
                }
            }
        })
    }
}

/// Draws a value uniformly from [−1, 1), with a counter-based generator that carries no state.
fn draw(seed: u64, step: u32, entry: usize) -> f32 {
    let stream = splitmix64(seed.wrapping_add(u64::from(step).wrapping_mul(SPLITMIX_GAMMA)));
    2.0 * unit(stream, entry) - 1.0
}
