//! The choice of the number of envs, and the trials behind it, as the report of a run shows them.

use serde::Serialize;

/// Speed with a number of envs, predicted from its costs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct EnvTrial {
    pub(crate) envs: u32,
    /// Predicted control steps per second of an otherwise idle machine.
    pub(crate) predicted: f64,
    /// Fraction that the children used of the core time that other programs left to them.
    pub(crate) utilisation: f64,
    /// Fraction of the core time that other programs took.
    pub(crate) foreign: f64,
}

/// The current choice and the trials behind it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct EnvChoice {
    /// Number of envs.
    pub(crate) envs: u32,
    /// Largest number that memory, cores and episodes admit.
    pub(crate) max_envs: u32,
    pub(crate) trials: Vec<EnvTrial>,
}
