//! The error for an episode that cannot be shown.

use thiserror::Error;

use crate::episode::DivergedError;
use crate::expert::MotionPlanError;

/// Errors that can occur while rolling out an episode to show.
#[derive(Debug, Error)]
pub enum ShowError {
    /// The expert's waypoints are not reachable.
    #[error("the expert found no plan")]
    Plan(#[from] MotionPlanError),
    /// The simulation diverged.
    #[error(transparent)]
    Diverged(#[from] DivergedError),
}
