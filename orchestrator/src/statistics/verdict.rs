//! Verdicts on a comparison: which policy is better, whether any difference is small, or how many
//! episodes are missing.

use serde::{Deserialize, Serialize};

use super::holm::holm;
use super::normal::quantile;
use super::paired::Pairs;

/// Probability with which a planned number of episodes leads to a decision.
pub const POWER: f64 = 0.8;

/// The level and the margin of verdicts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Levels {
    /// Probability of a false verdict, for example 0.05.
    pub alpha: f64,
    /// Smallest difference of success rates that matters, for example 0.05.
    pub margin: f64,
}

impl Levels {
    /// Returns the normal quantile of a two-sided interval at `1 − alpha`.
    #[must_use]
    pub fn z(&self) -> f64 {
        quantile(1.0 - self.alpha / 2.0)
    }
}

/// The kind of a verdict.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Decision {
    /// A succeeds more often.
    ABetter,
    /// B succeeds more often.
    BBetter,
    /// No difference is larger than the margin.
    Equivalent,
    /// The episodes do not suffice for any of these.
    Undecided,
}

/// The verdict on the difference of two success rates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// The kind of the verdict.
    pub decision: Decision,
    /// Estimated number of further episodes per cell, if undecided and the rates are as observed: those with
    /// which a comparison decides with a probability of [`POWER`], or the forecast of a [`PairedSequence`].
    ///
    /// [`PairedSequence`]: super::PairedSequence
    pub more_episodes: Option<u64>,
}

impl Decision {
    /// Decides from adjusted p-values of equal rates and of a difference of at least the margin.
    fn new(difference: f64, adjusted_p: f64, adjusted_equivalence_p: f64, alpha: f64) -> Self {
        if adjusted_p <= alpha && difference != 0.0 {
            if difference > 0.0 { Self::ABetter } else { Self::BBetter }
        } else if adjusted_equivalence_p <= alpha {
            Self::Equivalent
        } else {
            Self::Undecided
        }
    }
}

/// A pair's probabilities, from which numbers of episodes are planned.
#[derive(Clone, Copy, Debug)]
pub struct PairRates {
    /// Success rate of A minus that of B.
    pub difference: f64,
    /// Probability that exactly one side succeeds.
    pub discordance: f64,
}

impl PairRates {
    /// Estimates the rates. A pair is added to the discordant ones, because none seen does not mean none to
    /// come.
    pub(crate) fn smoothed(difference: f64, n_discordant: f64, n: f64) -> Self {
        Self { difference, discordance: (n_discordant + 1.0) / (n + 1.0) }
    }

    /// Returns the rates of a cell; `None` without pairs.
    #[must_use]
    pub fn of_cell(pairs: &Pairs) -> Option<Self> {
        Some(Self::smoothed(pairs.difference()?, f64::from(pairs.discordant()), f64::from(pairs.n())))
    }

    /// Returns the number of pairs with which equal rates, or a difference of at least the margin, are
    /// rejected with a probability of [`POWER`], as the first of `n_tests` tests of that kind by Holm's
    /// method; infinite if neither can be. The formula for equal rates is that of R. J. Connor (Biometrics
    /// 43:207, 1987).
    #[must_use]
    pub fn pairs_needed(self, levels: Levels, n_tests: [usize; 2]) -> f64 {
        let Self { difference, discordance } = self;
        let (distance, alphas) = (difference.abs(), n_tests.map(|n| levels.alpha / n.max(1) as f64));
        let deviation = (discordance - distance * distance).max(0.0).sqrt();
        // The continuity correction of the tests costs about one pair per unit of distance.
        let needed = |deviations: f64, distance: f64| {
            if distance > 0.0 { (deviations / distance).powi(2) + distance.recip() } else { f64::INFINITY }
        };
        let z = quantile(1.0 - alphas[0] / 2.0);
        let different = needed(z * discordance.sqrt() + quantile(POWER) * deviation, distance);
        // Both one-sided tests must reject.
        let both = quantile(0.5 + 0.5 * POWER);
        let equivalent = needed((quantile(1.0 - alphas[1]) + both) * deviation, levels.margin - distance);
        different.min(equivalent)
    }
}

impl Verdict {
    /// Formats the verdict on two policies for people.
    #[must_use]
    pub fn text(&self, names: [&str; 2], margin: f64) -> String {
        match self.decision {
            Decision::ABetter => format!("{} better", names[0]),
            Decision::BBetter => format!("{} better", names[1]),
            Decision::Equivalent => format!("no difference larger than {:.1} pp", 100.0 * margin),
            Decision::Undecided => match self.more_episodes {
                Some(1) => "undecided: about 1 more episode".to_owned(),
                Some(more) => format!("undecided: about {more} more episodes"),
                None => "undecided".to_owned(),
            },
        }
    }
}

/// A difference and its two tests.
#[derive(Clone, Copy, Debug)]
pub struct TestedDifference {
    /// Success rate of A minus that of B.
    pub difference: f64,
    /// p-value of equal rates.
    pub p: f64,
    /// p-value against a difference of at least the margin in either direction.
    pub equivalence_p: f64,
}

/// The conclusion of one row among all rows of a table.
#[derive(Clone, Copy, Debug)]
pub struct Judgement {
    /// The p-values, adjusted by Holm's method.
    pub adjusted_p: f64,
    /// The same of the other test.
    pub adjusted_equivalence_p: f64,
    /// The decision that follows.
    pub decision: Decision,
}

/// Judges the rows of a table together. Both kinds of p-values are adjusted by Holm's method, so that each
/// kind of false verdict occurs anywhere in the table with a probability of at most `alpha`.
#[must_use]
pub fn judge(rows: &[TestedDifference], alpha: f64) -> Vec<Judgement> {
    let adjusted =
        |p: fn(&TestedDifference) -> f64| holm(&rows.iter().map(p).collect::<Vec<_>>()).into_iter();
    let adjusted = adjusted(|row| row.p).zip(adjusted(|row| row.equivalence_p));
    let judged = rows.iter().zip(adjusted).map(|(row, (adjusted_p, adjusted_equivalence_p))| Judgement {
        adjusted_p,
        adjusted_equivalence_p,
        decision: Decision::new(row.difference, adjusted_p, adjusted_equivalence_p, alpha),
    });
    judged.collect()
}

/// Returns the numbers of tests of equal rates and of equivalence that have not rejected. Holm's method
/// judges the next one at alpha over this number.
#[must_use]
pub fn n_open_tests(judged: &[Judgement], alpha: f64) -> [usize; 2] {
    let open = |p: fn(&Judgement) -> f64| judged.iter().filter(|row| p(row) > alpha).count();
    [open(|row| row.adjusted_p), open(|row| row.adjusted_equivalence_p)]
}
