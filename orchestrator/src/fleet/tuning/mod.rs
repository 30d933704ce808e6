//! The number of environments in use, from what sims and hosts report.

pub(crate) mod env_choice;
pub(crate) mod totals;
pub(crate) mod tuner;
