//! Differences averaged over cells.
//!
//! The cells of a task share their episodes' starts (twins), so pairs with the same task and episode index
//! form a cluster. The mean is treated as the difference of as many independent pairs as have its variance:
//! the number of pairs, divided by the design effect of the clusters (L. Kish, Survey Sampling, 1965), which
//! starts from that of identical twins and follows the data. Its interval and tests are score-type. So a mean
//! of few pairs, or of pairs without a discordant one, keeps a width. The tasks are fixed, not sampled.

use std::collections::BTreeMap;

use serde::Serialize;

use super::normal::quantile;
use super::score::{CONTINUITY, ScoreCounts};
use super::verdict::{Levels, PairRates, TestedDifference};

/// Weight of the cluster that is added to the design effect. With less, few discordant pairs are taken for
/// independent ones (bench `conclusions`).
const PRIOR: f64 = 0.25;

/// Differences of one cell by episode index.
#[derive(Clone, Debug)]
pub struct DifferenceCell {
    /// Index of the cell's task. Cells of one task are a cluster per episode index.
    pub task_idx: usize,
    /// `a − b` per episode index of the task: −1, 0 or 1; `None` where the pair is missing.
    pub differences: Vec<Option<i8>>,
}

/// The mean difference over the cells of a group.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MeanDifference {
    /// Weighted mean of the cells' differences.
    pub mean: f64,
    /// Interval at 1 − alpha.
    pub interval: [f64; 2],
    /// p-value of a mean of zero.
    pub p: f64,
    /// p-value against a mean of at least the margin in either direction.
    pub equivalence_p: f64,
    /// Number of cells.
    pub n_cells: usize,
    /// Number of independent pairs with the same variance.
    pub n_effective: f64,
    /// Mean share of discordant pairs.
    pub discordance: f64,
}

/// The part of a cell in the mean.
struct Moments {
    /// Weight of the cell; the weights of a mean add up to 1.
    weight: f64,
    n: f64,
    /// Shares of pairs in which only A and only B succeeds.
    only_a: f64,
    only_b: f64,
}

impl MeanDifference {
    /// Averages cells with positive weights; `None` without cells. Cells without any pair must be left out by
    /// the caller.
    #[must_use]
    pub fn new(cells: &[(f64, &DifferenceCell)], levels: Levels) -> Option<Self> {
        let total: f64 = cells.iter().map(|(weight, _)| weight).sum();
        let moments: Vec<Moments> =
            cells.iter().map(|(weight, cell)| Moments::new(weight / total, cell)).collect();
        let average =
            |share: fn(&Moments) -> f64| moments.iter().map(|cell| cell.weight * share(cell)).sum::<f64>();
        let [only_a, only_b] = [average(|cell| cell.only_a), average(|cell| cell.only_b)];
        let (mean, discordance) = (only_a - only_b, only_a + only_b);
        if cells.is_empty() {
            return None;
        }
        // Variance of the mean of independent pairs, per unit of a pair's variance.
        let independent: f64 = moments.iter().map(|cell| cell.weight.powi(2) / cell.n).sum();
        let design_effect = design_effect(cells, &moments, mean, independent * (discordance - mean * mean));
        let n = 1.0 / (independent * design_effect);
        let counts = ScoreCounts { n, only_a: n * only_a, only_b: n * only_b };
        Some(Self {
            mean,
            interval: counts.interval(quantile(1.0 - levels.alpha / 2.0), CONTINUITY),
            p: counts.p_value(),
            equivalence_p: counts.equivalence_p(levels.margin),
            n_cells: cells.len(),
            n_effective: n,
            discordance,
        })
    }

    /// Returns the mean with its tests.
    #[must_use]
    pub fn tested(&self) -> TestedDifference {
        TestedDifference { difference: self.mean, p: self.p, equivalence_p: self.equivalence_p }
    }

    /// Returns the rates from which numbers of episodes are planned.
    pub(crate) fn rates(&self) -> PairRates {
        PairRates::smoothed(self.mean, self.discordance * self.n_effective, self.n_effective)
    }
}

impl Moments {
    fn new(weight: f64, cell: &DifferenceCell) -> Self {
        let present = || cell.differences.iter().flatten();
        let n = present().count() as f64;
        let share = |sign| present().filter(|difference| **difference == sign).count() as f64 / n;
        Self { weight, n, only_a: share(1), only_b: share(-1) }
    }
}

/// Returns the variance of the mean relative to `independent`, that of independent pairs, but at least 1.
/// Both get a part of one more cluster, of an average task, whose pairs are all discordant.
fn design_effect(cells: &[(f64, &DifferenceCell)], moments: &[Moments], mean: f64, independent: f64) -> f64 {
    // By task: its residuals per episode index, and the largest variance of one index and of its pairs.
    let mut tasks: BTreeMap<usize, (Vec<f64>, f64, f64)> = BTreeMap::new();
    for ((_, cell), Moments { weight, n, only_a, only_b }) in cells.iter().zip(moments) {
        let (residuals, largest, squares) = tasks.entry(cell.task_idx).or_default();
        residuals.resize(residuals.len().max(cell.differences.len()), 0.0);
        // A single pair has no spread of its own.
        let (center, scale) =
            if *n > 1.0 { (only_a - only_b, weight / (n * (n - 1.0)).sqrt()) } else { (mean, *weight) };
        for (sum, difference) in residuals.iter_mut().zip(&cell.differences) {
            *sum += difference.map_or(0.0, |difference| scale * (f64::from(difference) - center));
        }
        *largest += weight / n;
        *squares += (weight / n).powi(2);
    }
    let n_tasks = tasks.len() as f64;
    let (mut clustered, mut independent) = (0.0, independent);
    for (residuals, largest, squares) in tasks.values() {
        clustered += residuals.iter().map(|sum| sum * sum).sum::<f64>() + PRIOR * largest * largest / n_tasks;
        independent += PRIOR * squares / n_tasks;
    }
    (clustered / independent).max(1.0)
}
