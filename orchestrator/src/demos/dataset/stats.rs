//! Statistics of features, per episode and over all of them, by LeRobot's definitions: a quantile over all episodes is the mean
//! of theirs, weighted by frames.

use serde::{Deserialize, Serialize};

/// Quantiles that are kept, and their names.
pub(super) const QUANTILES: [(f64, &str); 5] =
    [(0.01, "q01"), (0.1, "q10"), (0.5, "q50"), (0.9, "q90"), (0.99, "q99")];
/// Levels of a colour.
const LEVELS: usize = 256;

/// Of one feature: each list has a number for each of its entries, or for each channel of an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Stats {
    pub(super) min: Vec<f64>,
    pub(super) max: Vec<f64>,
    pub(super) mean: Vec<f64>,
    pub(super) std: Vec<f64>,
    /// Frames.
    pub(super) count: u64,
    /// As [`QUANTILES`].
    pub(super) quantiles: [Vec<f64>; 5],
}

impl Stats {
    /// Of numbers `[n_frames, width]`.
    pub(super) fn of_numbers(numbers: &[f32], width: usize) -> Self {
        let n = numbers.len() / width;
        let columns = (0..width).map(|col| {
            let mut column: Vec<f64> =
                numbers.iter().skip(col).step_by(width).map(|&x| f64::from(x)).collect();
            column.sort_by(f64::total_cmp);
            let mean = column.iter().sum::<f64>() / n as f64;
            let variance = column.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n as f64;
            Of {
                min: column[0],
                max: column[n - 1],
                mean,
                std: variance.sqrt(),
                quantiles: QUANTILES.map(|(q, _)| between(&column, q)),
            }
        });
        Self::from_columns(columns, n as u64)
    }

    /// Of images' colours, as parts of full scale.
    pub(super) fn of_colors(histograms: &[Histogram; 3], n_frames: u64) -> Self {
        Self::from_columns(histograms.iter().map(Histogram::of), n_frames)
    }

    /// Over several episodes.
    ///
    /// # Panics
    /// If there are none, or they are of different features.
    pub(super) fn over(episodes: &[&Self]) -> Self {
        let count: u64 = episodes.iter().map(|stats| stats.count).sum();
        let width = episodes.iter().map(|stats| stats.mean.len()).max().unwrap_or(0);
        let columns = (0..width).map(|col| {
            let weighted = |of: &dyn Fn(&Self) -> f64| {
                episodes.iter().map(|stats| stats.count as f64 * of(stats)).sum::<f64>() / count as f64
            };
            let mean = weighted(&|stats| stats.mean[col]);
            let variance = weighted(&|stats| stats.std[col].powi(2) + (stats.mean[col] - mean).powi(2));
            Of {
                min: episodes.iter().map(|stats| stats.min[col]).fold(f64::INFINITY, f64::min),
                max: episodes.iter().map(|stats| stats.max[col]).fold(f64::NEG_INFINITY, f64::max),
                mean,
                std: variance.sqrt(),
                quantiles: core::array::from_fn(|q| weighted(&|stats| stats.quantiles[q][col])),
            }
        });
        Self::from_columns(columns, count)
    }

    fn from_columns(columns: impl Iterator<Item = Of>, count: u64) -> Self {
        let columns: Vec<Of> = columns.collect();
        let each = |of: &dyn Fn(&Of) -> f64| columns.iter().map(of).collect();
        Self {
            min: each(&|of| of.min),
            max: each(&|of| of.max),
            mean: each(&|of| of.mean),
            std: each(&|of| of.std),
            count,
            quantiles: core::array::from_fn(|q| each(&|of| of.quantiles[q])),
        }
    }
}

/// Of one entry.
struct Of {
    min: f64,
    max: f64,
    mean: f64,
    std: f64,
    quantiles: [f64; 5],
}

/// How often each level of a colour was seen.
#[derive(Clone, Debug)]
pub(super) struct Histogram([u64; LEVELS]);

impl Default for Histogram {
    fn default() -> Self {
        Self([0; LEVELS])
    }
}

impl Histogram {
    /// Counts the pixels of an image `[height, width, 3]`.
    pub(super) fn count(histograms: &mut [Self; 3], image: &[u8]) {
        for pixel in image.as_chunks::<3>().0 {
            histograms
                .iter_mut()
                .zip(pixel)
                .for_each(|(histogram, &level)| histogram.0[usize::from(level)] += 1);
        }
    }

    fn of(&self) -> Of {
        let seen =
            || self.0.iter().enumerate().filter(|(_, n)| **n > 0).map(|(level, &n)| (part(level), n as f64));
        let n: f64 = seen().map(|(_, n)| n).sum();
        let mean = seen().map(|(level, n)| level * n).sum::<f64>() / n;
        let variance = seen().map(|(level, n)| (level - mean).powi(2) * n).sum::<f64>() / n;
        let quantile = |q: f64| {
            let mut up_to = 0.0;
            let mut levels = seen().skip_while(|(_, n_here)| {
                up_to += n_here;
                up_to <= q * (n - 1.0)
            });
            levels.next().map_or(0.0, |(level, _)| level)
        };
        Of {
            min: seen().map(|(level, _)| level).fold(f64::INFINITY, f64::min),
            max: seen().map(|(level, _)| level).fold(f64::NEG_INFINITY, f64::max),
            mean,
            std: variance.sqrt(),
            quantiles: QUANTILES.map(|(q, _)| quantile(q)),
        }
    }
}

/// A level as a part of full scale.
fn part(level: usize) -> f64 {
    level as f64 / (LEVELS - 1) as f64
}

/// The quantile of sorted numbers, between the nearest two.
fn between(sorted: &[f64], q: f64) -> f64 {
    let at = q * (sorted.len() - 1) as f64;
    let (below, above) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    below + (above - below) * at.fract()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_of_parts_are_those_of_the_whole() {
        let numbers: Vec<f32> = (0..60).map(|i| ((i * 37 + 11) % 59) as f32 / 7.0).collect();
        let whole = Stats::of_numbers(&numbers, 2);
        let parts = [Stats::of_numbers(&numbers[..14], 2), Stats::of_numbers(&numbers[14..], 2)];
        let over = Stats::over(&parts.each_ref());
        assert_eq!((over.count, &over.min, &over.max), (30, &whole.min, &whole.max));
        for (a, b) in [(&over.mean, &whole.mean), (&over.std, &whole.std)] {
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12), "{a:?} {b:?}");
        }
        assert_eq!(Stats::of_numbers(&[3.0, 1.0, 2.0], 1).quantiles[2], [2.0]);
        assert_eq!(Stats::of_numbers(&[0.0, 1.0], 1).quantiles[1], [0.1]);
    }

    #[test]
    fn colours_are_parts_of_full_scale() {
        let mut histograms: [Histogram; 3] = Default::default();
        Histogram::count(&mut histograms, &[0, 255, 51, 255, 255, 51, 0, 255, 102]);
        let stats = Stats::of_colors(&histograms, 1);
        assert_eq!((stats.min, stats.max), (vec![0.0, 1.0, 0.2], vec![1.0, 1.0, 0.4]));
        assert!(
            (stats.mean[0] - 1.0 / 3.0).abs() < 1e-12
                && (stats.std[0] - (2.0_f64 / 9.0).sqrt()).abs() < 1e-12
        );
        assert_eq!(stats.quantiles[2], [0.0, 1.0, 0.2]);
    }
}
