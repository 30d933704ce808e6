//! An observation between its arrival and its answer.

use ipc_types::link::ObservationMessage;
use ipc_types::{FrameError, ObservationHeader, ObservationView};
use thiserror::Error;

use super::protocol::HostConfig;
use crate::policy::PolicyError;

/// An observation that was received.
pub(crate) struct PendingAnswer {
    pub(crate) header: ObservationHeader,
    pub(crate) message: ObservationMessage,
    /// Outcome of its submission to the policy's pipeline; `Ok` if it has none.
    pub(crate) submitted: Result<(), QueryError>,
}

impl PendingAnswer {
    /// Returns the observation, checked against what the host serves.
    pub(crate) fn view(&self, config: &HostConfig) -> Result<ObservationView<'_>, QueryError> {
        let view = ObservationView::new(self.header, self.message.pages())?;
        let (expected, found) = (config.run_id, self.header.run);
        if expected != found {
            return Err(QueryError::Run { expected, found });
        }
        let limit = config.lane.max_envs;
        if view.n_envs() as u32 > limit.max(1) {
            return Err(QueryError::Envs { found: self.header.n_envs, limit });
        }
        Ok(view)
    }
}

/// Errors that can occur while answering an observation.
#[derive(Debug, Error)]
pub(crate) enum QueryError {
    #[error(transparent)]
    Frame(#[from] FrameError),
    #[error("the observation belongs to run {found:#x}, this host serves run {expected:#x}")]
    Run { expected: u64, found: u64 },
    #[error("the observation has {found} envs, the lane allows {limit}")]
    Envs { found: u32, limit: u32 },
    #[error("the observation was overwritten in shared memory")]
    Damaged(#[source] FrameError),
    #[error(transparent)]
    Policy(#[from] PolicyError),
}

impl QueryError {
    pub(crate) fn is_damage(&self) -> bool {
        matches!(self, Self::Damaged(_))
    }
}
