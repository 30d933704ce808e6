//! The floor: a policy that holds still.

use ipc_types::ObservationView;

use crate::policy::{ActionChunk, Policy, PolicyError};
use crate::rows::fill_rows;

/// Commands the measured joints, or no motion, and the grippers where they are.
#[derive(Clone, Copy, Debug)]
pub struct IdlePolicy;

impl Policy for IdlePolicy {
    fn act(
        &mut self,
        observation: &ObservationView<'_>,
        answer: &mut [ActionChunk],
    ) -> Result<(), PolicyError> {
        fill_rows("idle", observation, answer, |_, _, _| {})
    }
}
