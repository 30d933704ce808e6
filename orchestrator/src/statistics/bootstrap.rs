//! Cluster bootstrap of differences averaged over cells (B. Efron, JASA 82:171, 1987, for the corrected
//! interval).
//!
//! The cells of a task share their episodes' starts (twins), so episode indices are resampled, for all
//! cells of the task together.

use rayon::prelude::*;
use serde::Serialize;
use sim::stream::Stream;

use super::normal::{cdf, quantile};

/// Number of resamples.
const N_RESAMPLES: usize = 10_000;
/// Resamples per random stream, which is the unit of parallel work.
const PER_STREAM: usize = 100;
/// Seed of all resamples.
const SEED: u64 = 0;
/// Smallest difference of a bound at which the corrected interval replaces the percentile interval.
const MIN_CORRECTION: f64 = 0.005;

/// Differences of one cell by episode index.
#[derive(Clone, Debug)]
pub struct BootstrapCell {
    /// Index of the cell's task. Cells of one task are resampled together.
    pub task_idx: usize,
    /// `a − b` per episode index of the task: −1, 0 or 1; `None` where the pair is missing.
    pub differences: Vec<Option<i8>>,
}

/// The interval that an [`Estimate`] has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum IntervalMethod {
    /// Quantiles of the resampled means.
    Percentile,
    /// Quantiles corrected for bias and skew.
    #[serde(rename = "bca")]
    BiasCorrected,
}

/// The mean difference over the cells of a group.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Unweighted mean of the cells' differences.
    pub mean: f64,
    /// Interval at 1 − alpha.
    pub interval: [f64; 2],
    /// Method of the interval.
    pub method: IntervalMethod,
    /// Interval at 1 − 2 alpha, whose bounds are two one-sided tests.
    pub one_sided: [f64; 2],
    /// Number of cells.
    pub n_cells: usize,
}

/// One cell in the form that resampling sums fastest.
struct Prepared {
    differences: Vec<i8>,
    /// 1 where a pair exists; `None` if all do.
    present: Option<Vec<u8>>,
}

/// Returns the mean of each group of cells with its interval at `1 − alpha`. A group lists indices into
/// `cells`; the estimate of an empty group is `None`.
///
/// Cells without any pair must be left out by the caller. The result is the same on every machine.
#[must_use]
pub fn cluster_bootstrap(
    cells: &[BootstrapCell],
    groups: &[Vec<usize>],
    alpha: f64,
) -> Vec<Option<Estimate>> {
    let prepared: Vec<Prepared> = cells.iter().map(Prepared::new).collect();
    let tasks = tasks(cells);
    let resampled = resample(&prepared, &tasks, groups);
    let estimate = |(group_idx, group): (usize, &Vec<usize>)| {
        if group.is_empty() {
            return None;
        }
        let means = resampled.iter().map(|row| row[group_idx]).filter(|mean| mean.is_finite());
        let mut means: Vec<f64> = means.collect();
        means.sort_by(f64::total_cmp);
        let members: Vec<&BootstrapCell> = group.iter().map(|&idx| &cells[idx]).collect();
        let mean = group.iter().map(|&idx| prepared[idx].mean()).sum::<f64>() / group.len() as f64;
        let acceleration = acceleration(&members);
        let at = |alpha| interval(&means, mean, acceleration, alpha);
        let ((interval, method), (one_sided, _)) = (at(alpha), at(2.0 * alpha));
        Some(Estimate { mean, interval, method, one_sided, n_cells: group.len() })
    };
    groups.iter().enumerate().map(estimate).collect()
}

/// Returns the indices of the cells of each task, with the task's number of episode indices.
fn tasks(cells: &[BootstrapCell]) -> Vec<(usize, Vec<usize>)> {
    let mut tasks: std::collections::BTreeMap<usize, (usize, Vec<usize>)> = std::collections::BTreeMap::new();
    for (idx, cell) in cells.iter().enumerate() {
        let task = tasks.entry(cell.task_idx).or_default();
        task.0 = task.0.max(cell.differences.len());
        task.1.push(idx);
    }
    tasks.into_values().collect()
}

/// Returns the mean of each group in each resample, `[N_RESAMPLES][n_groups]`.
fn resample(prepared: &[Prepared], tasks: &[(usize, Vec<usize>)], groups: &[Vec<usize>]) -> Vec<Vec<f64>> {
    let streams = (0..N_RESAMPLES / PER_STREAM).into_par_iter();
    let of_stream = |stream_idx: usize| {
        let mut random = Stream::new(SEED, &format!("bootstrap/{stream_idx}"));
        let (mut weights, mut means) = (Vec::new(), vec![0.0; prepared.len()]);
        let mut resample = || {
            for (n_episodes, cells) in tasks {
                weights.clear();
                weights.resize(*n_episodes, 0_u8);
                for _ in 0..*n_episodes {
                    let drawn = (random.unit() * *n_episodes as f64) as usize;
                    // 255 draws of one index do not happen: their probability is below 10⁻³⁰⁰.
                    weights[drawn] = weights[drawn].saturating_add(1);
                }
                for &cell in cells {
                    means[cell] = prepared[cell].weighted_mean(&weights);
                }
            }
            let mean =
                |group: &Vec<usize>| group.iter().map(|&cell| means[cell]).sum::<f64>() / group.len() as f64;
            groups.iter().map(mean).collect::<Vec<f64>>()
        };
        (0..PER_STREAM).map(|_| resample()).collect::<Vec<_>>()
    };
    streams.flat_map_iter(of_stream).collect()
}

impl Prepared {
    fn new(cell: &BootstrapCell) -> Self {
        let is_complete = cell.differences.iter().all(Option::is_some);
        Self {
            differences: cell.differences.iter().map(|difference| difference.unwrap_or(0)).collect(),
            present: (!is_complete)
                .then(|| cell.differences.iter().map(|difference| u8::from(difference.is_some())).collect()),
        }
    }

    fn mean(&self) -> f64 {
        self.weighted_mean(&vec![1; self.differences.len()])
    }

    /// Returns the mean with integer weights per episode index; not finite if no present pair has weight.
    fn weighted_mean(&self, weights: &[u8]) -> f64 {
        let pairs = self.differences.iter().zip(weights);
        let sum: i32 = pairs.map(|(difference, weight)| i32::from(*difference) * i32::from(*weight)).sum();
        let used = &weights[..self.differences.len()];
        let n: u32 = match &self.present {
            // As many indices are drawn as there are.
            None if used.len() == weights.len() => weights.len() as u32,
            None => used.iter().map(|weight| u32::from(*weight)).sum(),
            Some(present) => present.iter().zip(used).map(|(p, w)| u32::from(*p) * u32::from(*w)).sum(),
        };
        f64::from(sum) / f64::from(n)
    }
}

/// Returns the acceleration of the mean of cells: the skewness of the episodes' influence on it, over 6.
fn acceleration(cells: &[&BootstrapCell]) -> f64 {
    let mut influence: std::collections::BTreeMap<(usize, usize), f64> = std::collections::BTreeMap::new();
    for cell in cells {
        let present =
            || cell.differences.iter().enumerate().filter_map(|(idx, d)| Some((idx, f64::from((*d)?))));
        let n = present().count() as f64;
        let mean = present().map(|(_, difference)| difference).sum::<f64>() / n;
        for (idx, difference) in present() {
            *influence.entry((cell.task_idx, idx)).or_default() += (difference - mean) / n;
        }
    }
    let power = |exponent| influence.values().map(|value| value.powi(exponent)).sum::<f64>();
    let squares = power(2);
    if squares > 0.0 { power(3) / (6.0 * squares * squares.sqrt()) } else { 0.0 }
}

/// Returns the interval from the sorted resampled means.
fn interval(sorted: &[f64], mean: f64, acceleration: f64, alpha: f64) -> ([f64; 2], IntervalMethod) {
    let n = sorted.len() as f64;
    let at = |p: f64| sorted[((p * n) as usize).min(sorted.len() - 1)];
    let percentile = [at(alpha / 2.0), at(1.0 - alpha / 2.0)];
    // Means that equal the estimate count half, because differences are discrete.
    let below = sorted.partition_point(|value| *value < mean - 1e-12) as f64;
    let up_to = sorted.partition_point(|value| *value <= mean + 1e-12) as f64;
    let share = 0.5 * (below + up_to) / n;
    if share <= 0.0 || share >= 1.0 {
        return (percentile, IntervalMethod::Percentile);
    }
    let bias = quantile(share);
    let corrected = [alpha / 2.0, 1.0 - alpha / 2.0].map(|p| {
        let shifted = bias + quantile(p);
        at(cdf(bias + shifted / (1.0 - acceleration * shifted)))
    });
    let correction = percentile.iter().zip(corrected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    if correction > MIN_CORRECTION {
        (corrected, IntervalMethod::BiasCorrected)
    } else {
        (percentile, IntervalMethod::Percentile)
    }
}
