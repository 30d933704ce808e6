//! The idle policy, a floor for success rates.

use ipc_types::ObservationView;

use super::rows::fill_rows;
use crate::policy::{ActionChunk, Policy, PolicyError};

/// Commands zero motion, or the measured joint positions, and keeps the grippers at their current position.
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
