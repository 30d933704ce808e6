//! The rule of early stopping: which comparison ends cells, and at which levels.

use serde::{Deserialize, Serialize};

use crate::statistics::Levels;

/// The rule of a run, as the results file stores it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct StoppingRule {
    /// Names of the two policies.
    pub(crate) policies: [String; 2],
    pub(crate) levels: Levels,
}
