//! Statistics of comparisons: intervals, tests, corrections for many cells, and rules for stopping early.
//!
//! Everything here is a pure function of counts, without files, clocks or a global random generator, and
//! gives the same bits on every machine. `docs/conclusions.md` defines each quantity.

mod bootstrap;
mod holm;
mod normal;
mod paired;
mod sequential;
mod verdict;
mod wilson;

pub use self::bootstrap::{BootstrapCell, Estimate, IntervalMethod, cluster_bootstrap};
pub use self::holm::holm;
pub use self::normal::{Z95, cdf, quantile};
pub use self::paired::{Pairs, mcnemar_mid_p, newcombe_interval, tango_interval};
pub use self::sequential::{ConfidenceSequence, PairedSequence, discordance_ln_e};
pub use self::verdict::{Decision, Levels, Verdict, more_episodes, sequential_decision};
pub use self::wilson::wilson_interval;

#[cfg(test)]
mod tests;
