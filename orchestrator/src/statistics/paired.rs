//! Matched episodes of two policies: the difference of their success rates, its intervals and its test.

use serde::Serialize;

use super::score::ScoreCounts;

/// Counts of matched episodes by the outcomes of A and B.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Pairs {
    /// Both succeed (n11).
    pub both: u32,
    /// Only A succeeds (n10).
    pub only_a: u32,
    /// Only B succeeds (n01).
    pub only_b: u32,
    /// Both fail (n00).
    pub neither: u32,
}

impl Pairs {
    /// Counts one pair.
    pub fn add(&mut self, a: bool, b: bool) {
        match (a, b) {
            (true, true) => self.both += 1,
            (true, false) => self.only_a += 1,
            (false, true) => self.only_b += 1,
            (false, false) => self.neither += 1,
        }
    }

    /// Returns the number of pairs.
    #[must_use]
    pub fn n(&self) -> u32 {
        self.both + self.only_a + self.only_b + self.neither
    }

    /// Returns the number of pairs in which exactly one succeeds.
    #[must_use]
    pub fn discordant(&self) -> u32 {
        self.only_a + self.only_b
    }

    /// Returns the number of successes of A and of B.
    #[must_use]
    pub fn successes(&self) -> [u32; 2] {
        [self.both + self.only_a, self.both + self.only_b]
    }

    /// Returns the success rate of A minus that of B; `None` without pairs.
    #[must_use]
    pub fn difference(&self) -> Option<f64> {
        (self.n() > 0).then(|| (f64::from(self.only_a) - f64::from(self.only_b)) / f64::from(self.n()))
    }
}

impl From<&Pairs> for ScoreCounts {
    fn from(pairs: &Pairs) -> Self {
        Self { n: f64::from(pairs.n()), only_a: f64::from(pairs.only_a), only_b: f64::from(pairs.only_b) }
    }
}

/// Returns Tango's score interval of the difference (T. Tango, Statistics in Medicine 17:891, 1998) for the
/// normal quantile `z`; `None` without pairs.
#[must_use]
pub fn tango_interval(pairs: &Pairs, z: f64) -> Option<[f64; 2]> {
    (pairs.n() > 0).then(|| ScoreCounts::from(pairs).interval(z, 0.0))
}

/// Returns the p-value against a difference of at least `margin` in either direction, by two one-sided score
/// tests with continuity correction; 1 without pairs.
#[must_use]
pub fn equivalence_p(pairs: &Pairs, margin: f64) -> f64 {
    if pairs.n() > 0 { ScoreCounts::from(pairs).equivalence_p(margin) } else { 1.0 }
}

/// Returns the mid-P value of McNemar's test of equal success rates (M. W. Fagerland, S. Lydersen, P. Laake,
/// BMC Medical Research Methodology 13:91, 2013). It is 1 without discordant pairs.
#[must_use]
pub fn mcnemar_mid_p(pairs: &Pairs) -> f64 {
    let (m, k) = (pairs.discordant(), pairs.only_a.min(pairs.only_b));
    if m == 0 {
        return 1.0;
    }
    let probability =
        |successes: u32| libm::exp(ln_choose(m, successes) - f64::from(m) * core::f64::consts::LN_2);
    let below: f64 = (0..k).map(probability).sum();
    // With equal counts both tails meet in the middle, which counts half.
    if 2 * k == m { 1.0 - 0.5 * probability(k) } else { (2.0 * below + probability(k)).min(1.0) }
}

fn ln_choose(n: u32, k: u32) -> f64 {
    let ln_factorial = |n: u32| libm::lgamma(f64::from(n) + 1.0);
    ln_factorial(n) - ln_factorial(k) - ln_factorial(n - k)
}
