//! Tests that may be looked at after every episode: a test martingale on discordant pairs, and confidence
//! sequences of means.

use super::paired::Pairs;
use super::verdict::{Levels, TestedDifference};

/// Largest fraction of its capital that a bet may risk.
const MAX_RISK: f64 = 0.5;

/// Returns the logarithm of the e-value against equal success rates, given that `k` of `m` discordant pairs
/// favour A: the likelihood ratio of a Beta(½, ½) mixture to probability ½.
///
/// Under equal rates the running supremum exceeds `1/α` with a probability of at most α (J. Ville, 1939).
#[must_use]
pub fn discordance_ln_e(k: u32, m: u32) -> f64 {
    let ln_beta = |a: f64, b: f64| libm::lgamma(a) + libm::lgamma(b) - libm::lgamma(a + b);
    let (k, m) = (f64::from(k), f64::from(m));
    m * core::f64::consts::LN_2 + ln_beta(k + 0.5, m - k + 0.5) - ln_beta(0.5, 0.5)
}

/// The confidence sequence of the mean of observations in [0, 1]: the hedged betting sequence of
/// I. Waudby-Smith and A. Ramdas (JRSS-B 86:1, 2024), intersected over time.
///
/// With a probability of at least `1 − alpha` it contains the mean at all times together.
#[derive(Clone, Debug)]
pub struct ConfidenceSequence {
    alpha: f64,
    rounds: Vec<Round>,
    /// Sum and sum of squared deviations, with the prior of one observation of ½, from which bets are chosen.
    sum: f64,
    sum_of_squares: f64,
    interval: [f64; 2],
}

/// An observation and the bet that was chosen before it.
#[derive(Clone, Copy, Debug)]
struct Round {
    observation: f64,
    bet: f64,
}

impl ConfidenceSequence {
    /// Starts a sequence without observations.
    #[must_use]
    pub fn new(alpha: f64) -> Self {
        Self { alpha, rounds: Vec::new(), sum: 0.5, sum_of_squares: 0.25, interval: [0.0, 1.0] }
    }

    /// Appends an observation in [0, 1].
    pub fn push(&mut self, observation: f64) {
        let t = self.rounds.len() as f64 + 1.0;
        let variance = self.sum_of_squares / t;
        let bet = (2.0 * libm::log(2.0 / self.alpha) / (variance * t * libm::log(t + 1.0))).sqrt();
        self.rounds.push(Round { observation, bet });
        self.sum += observation;
        self.sum_of_squares += (observation - self.sum / (t + 1.0)).powi(2);
        self.narrow();
    }

    /// Returns the interval so far.
    #[must_use]
    pub fn interval(&self) -> [f64; 2] {
        self.interval
    }

    /// Returns the level at which the present interval lies above `mean`.
    fn p_above(&self, mean: f64) -> f64 {
        (2.0 / self.capital(mean, 1.0)).min(1.0)
    }

    /// Returns the level at which the present interval lies below `mean`.
    fn p_below(&self, mean: f64) -> f64 {
        (2.0 / self.capital(1.0 - mean, -1.0)).min(1.0)
    }

    /// Intersects the interval with the one that all rounds so far imply.
    fn narrow(&mut self) {
        let [low, high] = self.interval;
        // The capital of the bet on larger values falls with the hypothesised mean, the other one rises.
        let is_too_low = |mean: f64| self.capital(mean, 1.0) >= 2.0 / self.alpha;
        let is_too_high = |mean: f64| self.capital(1.0 - mean, -1.0) >= 2.0 / self.alpha;
        let new_low = if is_too_low(low) { bisect_outwards(low, high, is_too_low) } else { low };
        let new_high =
            if is_too_high(high) { -bisect_outwards(-high, -low, |mean| is_too_high(-mean)) } else { high };
        self.interval = [new_low, new_high.max(new_low)];
    }

    /// Returns the capital after betting that observations exceed the mean `distance` (with `sign` 1), or
    /// fall below the mean `1 − distance` (with `sign` −1).
    fn capital(&self, distance: f64, sign: f64) -> f64 {
        let max_bet = MAX_RISK / distance.max(f64::MIN_POSITIVE);
        let mirrored = |observation: f64| if sign > 0.0 { observation } else { 1.0 - observation };
        self.rounds.iter().fold(1.0, |capital, round| {
            capital * (1.0 + round.bet.min(max_bet) * (mirrored(round.observation) - distance))
        })
    }
}

/// The matched episodes of a cell in index order, and what may be concluded from them at any time.
#[derive(Clone, Debug)]
pub struct PairedSequence {
    levels: Levels,
    pairs: Pairs,
    max_ln_e: f64,
    /// Of `(a − b + 1) / 2`.
    sequence: ConfidenceSequence,
    /// Smallest levels so far at which differences of at most −margin and of at least margin are excluded.
    margin_p: [f64; 2],
    /// Sign of the difference when equal rates were first excluded at alpha.
    sign: Option<f64>,
}

impl PairedSequence {
    /// Starts a sequence without pairs.
    #[must_use]
    pub fn new(levels: Levels) -> Self {
        Self {
            levels,
            pairs: Pairs::default(),
            max_ln_e: 0.0,
            sequence: ConfidenceSequence::new(levels.alpha),
            margin_p: [1.0; 2],
            sign: None,
        }
    }

    /// Appends the next pair.
    pub fn push(&mut self, a: bool, b: bool) {
        self.pairs.add(a, b);
        self.max_ln_e = self.max_ln_e.max(discordance_ln_e(self.pairs.only_a, self.pairs.discordant()));
        self.sequence.push(0.5 * (f64::from(a) - f64::from(b) + 1.0));
        let margin = 0.5 * self.levels.margin;
        let p_values = [self.sequence.p_above(0.5 - margin), self.sequence.p_below(0.5 + margin)];
        for (smallest, p) in self.margin_p.iter_mut().zip(p_values) {
            *smallest = smallest.min(p);
        }
        if self.sign.is_none() && self.tested().p <= self.levels.alpha {
            self.sign = self.pairs.difference().map(f64::signum);
        }
    }

    /// Returns the counts of the pairs.
    #[must_use]
    pub fn pairs(&self) -> &Pairs {
        &self.pairs
    }

    /// Returns the difference with the smallest levels so far at which equal rates, and a difference of at
    /// least the margin, are rejected. They hold at every moment.
    #[must_use]
    pub fn tested(&self) -> TestedDifference {
        TestedDifference {
            difference: self.pairs.difference().unwrap_or(0.0),
            p: libm::exp(-self.max_ln_e).min(1.0),
            equivalence_p: self.margin_p[0].max(self.margin_p[1]),
        }
    }

    /// Returns the number of further pairs until `is_decided`, if the pairs so far repeat themselves in
    /// the same order; `None` if that takes more than three times as many as there are.
    #[must_use]
    pub fn forecast(&self, is_decided: impl Fn(TestedDifference) -> bool) -> Option<u64> {
        let mut future = self.clone();
        let n = self.sequence.rounds.len();
        (0..3 * n).find_map(|idx| {
            let observation = self.sequence.rounds[idx % n].observation;
            future.push(observation > 0.75, observation < 0.25);
            is_decided(future.tested()).then_some(idx as u64 + 1)
        })
    }

    /// Returns the interval of the difference of success rates: its confidence sequence, from the moment on
    /// at which equal rates are rejected without the values beyond zero.
    #[must_use]
    pub fn interval(&self) -> [f64; 2] {
        let [low, high] = self.sequence.interval().map(|mean| 2.0 * mean - 1.0);
        match self.sign {
            Some(sign) if sign > 0.0 => [low.max(0.0), high.max(0.0)],
            Some(_) => [low.min(0.0), high.min(0.0)],
            None => [low, high],
        }
    }
}

/// Bisects in 30 steps, to far below what a report shows. Returns a point at which `is_outside` is still
/// true, so that an interval that starts there is never too short.
fn bisect_outwards(mut low: f64, mut high: f64, is_outside: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..30 {
        let middle = low.midpoint(high);
        if is_outside(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}
