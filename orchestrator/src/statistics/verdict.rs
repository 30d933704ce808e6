//! Verdicts on a comparison: which policy is better, whether any difference is small, or how many
//! episodes are missing.

use serde::{Deserialize, Serialize};

use super::normal::quantile;
use super::paired::{Pairs, tango_interval};
use super::sequential::PairedSequence;

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

    /// Returns the normal quantile of an interval at `1 − 2 alpha`, whose bounds are two one-sided tests.
    #[must_use]
    pub fn z_one_sided(&self) -> f64 {
        quantile(1.0 - self.alpha)
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
    /// Estimated number of further episodes until a decision, if undecided and the rates stay as they are.
    pub more_episodes: Option<u64>,
}

impl Verdict {
    /// Judges a fixed number of pairs, given the p-value of equal rates, adjusted for the other cells.
    #[must_use]
    pub fn new(pairs: &Pairs, adjusted_p: f64, levels: Levels) -> Self {
        let difference = pairs.difference().unwrap_or(0.0);
        let decided = |decision| Self { decision, more_episodes: None };
        if adjusted_p <= levels.alpha && difference != 0.0 {
            return decided(if difference > 0.0 { Decision::ABetter } else { Decision::BBetter });
        }
        let interval = tango_interval(pairs, levels.z_one_sided());
        if interval.is_some_and(|[low, high]| -levels.margin < low && high < levels.margin) {
            return decided(Decision::Equivalent);
        }
        Self { decision: Decision::Undecided, more_episodes: more_episodes(pairs, levels) }
    }

    /// Formats the verdict for people, with the names of both sides.
    #[must_use]
    pub fn text(&self, names: [&str; 2], margin: f64) -> String {
        match (self.decision, self.more_episodes) {
            (Decision::ABetter, _) => format!("{} better", names[0]),
            (Decision::BBetter, _) => format!("{} better", names[1]),
            (Decision::Equivalent, _) => format!("no difference larger than {:.1} pp", 100.0 * margin),
            (Decision::Undecided, Some(1)) => "undecided: about 1 more episode".to_owned(),
            (Decision::Undecided, Some(more)) => format!("undecided: about {more} more episodes"),
            (Decision::Undecided, None) => "undecided".to_owned(),
        }
    }
}

/// Returns the decision that a sequence of pairs allows at this moment, given the level at which equal
/// rates are rejected, adjusted for the other cells; `None` if there is none yet. It needs no correction
/// for earlier looks.
#[must_use]
pub fn sequential_decision(sequence: &PairedSequence, adjusted_p: f64, levels: Levels) -> Option<Decision> {
    let difference = sequence.pairs().difference()?;
    let [low, high] = sequence.interval();
    if adjusted_p <= levels.alpha && difference != 0.0 {
        Some(if difference > 0.0 { Decision::ABetter } else { Decision::BBetter })
    } else if -levels.margin < low && high < levels.margin {
        Some(Decision::Equivalent)
    } else {
        None
    }
}

/// Returns the number of further episodes at which an interval around the present difference is expected to
/// exclude zero, or to lie within the margin, whichever needs fewer. `None` without pairs.
///
/// The variance is that of `a − b`, with half a pair added to each kind of discordant pairs, because none
/// seen does not mean none to come.
#[must_use]
pub fn more_episodes(pairs: &Pairs, levels: Levels) -> Option<u64> {
    let difference = pairs.difference()?.abs();
    let n = f64::from(pairs.n());
    let variance = (f64::from(pairs.discordant()) + 1.0) / (n + 1.0) - difference * difference;
    let needed = |z: f64, distance: f64| {
        if distance > 0.0 { variance.max(0.0) * (z / distance).powi(2) } else { f64::INFINITY }
    };
    let total = needed(levels.z(), difference).min(needed(levels.z_one_sided(), levels.margin - difference));
    total.is_finite().then(|| (total.ceil() - n).max(1.0) as u64)
}
