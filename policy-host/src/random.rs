//! Random actions, drawn by (episode, control step, entry) alone: the same however the rows are chunked.

use ipc_types::{ControlMode, ObservationView};

use crate::generated::{SPLITMIX_GAMMA, splitmix64, unit};
use crate::policy::{ActionChunk, Policy, PolicyError};
use crate::rows::fill_rows;

/// Farthest that a commanded joint is from the measured one.
const JOINT_REACH_RAD: f32 = 0.05;

/// Uniform in [−1, 1] for the tool's motion; for joints, a random walk in steps of at most 0.05 rad from where they
/// were measured. Grippers are uniform in [−1, 1] in both.
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
                    ControlMode::JointPos if !is_gripper => *x += JOINT_REACH_RAD * drawn,
                    _ => *x = drawn,
                }
            }
        })
    }
}

/// Uniform in [−1, 1): the generator's state is counted, not carried.
fn draw(seed: u64, step: u32, entry: usize) -> f32 {
    let of_step = splitmix64(seed.wrapping_add(u64::from(step).wrapping_mul(SPLITMIX_GAMMA)));
    2.0 * unit(of_step, entry) - 1.0
}
