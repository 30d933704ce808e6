//! The floor: a policy that holds still.

use ipc_types::{ActionBlock, ObservationView};

use crate::policy::{Policy, PolicyError};
use crate::rows::fill_rows;

/// Commands the measured joints, or no motion, and the grippers where they are.
#[derive(Clone, Copy, Debug)]
pub struct Idle;

impl Policy for Idle {
    fn act(
        &mut self,
        observation: &ObservationView<'_>,
        answer: &mut [ActionBlock],
    ) -> Result<(), PolicyError> {
        fill_rows("idle", observation, answer, |_, _, _| {})
    }
}
