//! Statistics of comparisons: intervals, tests, corrections for many cells, and rules for stopping early.
//!
//! Everything here is a pure function of counts, without files, clocks or a global random generator, and
//! gives the same bits on every machine. `docs/conclusions.md` defines each quantity.

mod holm;
mod mean;
mod normal;
mod paired;
mod score;
mod sequential;
mod verdict;
mod wilson;

pub use self::holm::holm;
pub use self::mean::{DifferenceCell, MeanDifference};
pub use self::normal::{Z95, cdf, quantile};
pub use self::paired::{Pairs, equivalence_p, mcnemar_mid_p, tango_interval};
pub use self::sequential::{ConfidenceSequence, PairedSequence, discordance_ln_e};
pub use self::verdict::{
    Decision, Judgement, Levels, POWER, PairRates, TestedDifference, Verdict, judge, n_open_tests,
};
pub use self::wilson::wilson_interval;

#[cfg(test)]
mod tests;
