//! Action chunks built row by row from the action that holds the current position.

use ipc_types::{EnvRecord, ObservationView};

use super::robot_state::RobotState;
use crate::policy::{ActionChunk, PolicyError};

/// Fills the chunk of every env with as many rows as the sim will execute. Each row holds the current
/// position before `modify(record, control step, row)` changes it.
pub(crate) fn fill_rows(
    policy: &'static str,
    observation: &ObservationView<'_>,
    answer: &mut [ActionChunk],
    modify: impl Fn(&EnvRecord, u32, &mut [f32]),
) -> Result<(), PolicyError> {
    assert_eq!(answer.len(), observation.n_envs(), "one chunk per env");
    let (morphology, control_mode) = (observation.morphology(), observation.control_mode());
    let action_dim = control_mode.action_dim(morphology);
    for (env_idx, chunk) in answer.iter_mut().enumerate() {
        let env = observation.env(env_idx);
        let (expected, found) = (morphology.state_dim(), env.state.len());
        if expected != found {
            return Err(PolicyError::StateDim { env_idx, expected, found });
        }
        let robot = RobotState::new(env.state, morphology);
        let rows = chunk.reset(env.record.execute as usize, action_dim);
        for (row, offset) in rows.chunks_exact_mut(action_dim).zip(0..) {
            if !robot.write_hold(control_mode, row) {
                return Err(PolicyError::Unsupported { policy, control_mode: control_mode.name() });
            }
            modify(env.record, env.record.step.wrapping_add(offset), row);
        }
    }
    Ok(())
}
