//! Matched episodes of two policies: the difference of their success rates, its intervals and its test.

use serde::Serialize;

use super::normal::bisect;
use super::wilson::wilson_interval;

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

/// Returns Tango's score interval of the difference (T. Tango, Statistics in Medicine 17:891, 1998) for the
/// normal quantile `z`; `None` without pairs.
///
/// The bounds are the differences δ at which the score statistic
/// `(n10 − n01 − nδ) / √(n (2 q + δ (1 − δ)))` equals ± z, where q is the maximum-likelihood estimate of the
/// probability of n01 given δ.
#[must_use]
pub fn tango_interval(pairs: &Pairs, z: f64) -> Option<[f64; 2]> {
    let observed = pairs.difference()?;
    let score = |delta: f64| {
        let (n, b, c) = (f64::from(pairs.n()), f64::from(pairs.only_a), f64::from(pairs.only_b));
        let linear = -b - c + (2.0 * n - b + c) * delta;
        let constant = -c * delta * (1.0 - delta);
        let q = ((linear * linear - 8.0 * n * constant).max(0.0).sqrt() - linear) / (4.0 * n);
        let variance = n * (2.0 * q + delta * (1.0 - delta));
        // At δ = ±1 the variance is zero, and only an observed difference of ±1 is compatible.
        (b - c - n * delta) / variance.max(f64::MIN_POSITIVE).sqrt()
    };
    Some([bisect(-1.0, observed, |delta| score(delta) > z), bisect(observed, 1.0, |delta| score(delta) > -z)])
}

/// Returns Newcombe's interval of the difference, method 10 (R. G. Newcombe, Statistics in Medicine
/// 17:2635, 1998), for the normal quantile `z`; `None` without pairs. It combines Wilson's intervals of
/// both rates with their correlation, corrected for continuity.
#[must_use]
pub fn newcombe_interval(pairs: &Pairs, z: f64) -> Option<[f64; 2]> {
    let observed = pairs.difference()?;
    let n = f64::from(pairs.n());
    let [a, b, c, d] = [pairs.both, pairs.only_a, pairs.only_b, pairs.neither].map(f64::from);
    let margins = (a + b) * (c + d) * (a + c) * (b + d);
    let determinant = a * d - b * c;
    let corrected = if determinant > 0.0 { (determinant - n / 2.0).max(0.0) } else { determinant };
    let phi = if margins > 0.0 { corrected / margins.sqrt() } else { 0.0 };
    let [successes_a, successes_b] = pairs.successes();
    let distances = |successes: u32| {
        let p = f64::from(successes) / n;
        let [low, high] = wilson_interval(successes, pairs.n(), z)?;
        Some([p - low, high - p])
    };
    let ([low_a, high_a], [low_b, high_b]) = (distances(successes_a)?, distances(successes_b)?);
    let combined = |x: f64, y: f64| (x * x - 2.0 * phi * x * y + y * y).max(0.0).sqrt();
    Some([observed - combined(low_a, high_b), observed + combined(high_a, low_b)])
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
