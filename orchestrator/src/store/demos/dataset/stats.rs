//! Statistics of features, of one episode or of a whole dataset, by LeRobot's definitions. Those of a dataset
//! are computed over all its frames: a mean of the episodes' quantiles, as LeRobot forms it, is no quantile.

use serde::{Deserialize, Serialize};

/// The stored quantiles and their names.
pub(crate) const QUANTILES: [(f64, &str); 5] =
    [(0.01, "q01"), (0.1, "q10"), (0.5, "q50"), (0.9, "q90"), (0.99, "q99")];
/// Values of an 8-bit colour channel.
const LEVELS: usize = 256;

/// The statistics of one feature. Each list has one value per component of a vector, or per channel of an
/// image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct FeatureStats {
    pub(crate) min: Vec<f64>,
    pub(crate) max: Vec<f64>,
    pub(crate) mean: Vec<f64>,
    pub(crate) std: Vec<f64>,
    /// Number of frames.
    pub(crate) count: u64,
    /// In the order of [`QUANTILES`].
    pub(crate) quantiles: [Vec<f64>; 5],
}

impl FeatureStats {
    /// Computes the statistics of values `[n_frames, width]`.
    pub(crate) fn of_values(values: &[f32], width: usize) -> Self {
        let n = values.len() / width;
        let columns = (0..width).map(|col| {
            let mut column: Vec<f64> =
                values.iter().skip(col).step_by(width).map(|&x| f64::from(x)).collect();
            column.sort_by(f64::total_cmp);
            let mean = column.iter().sum::<f64>() / n as f64;
            let variance = column.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n as f64;
            ComponentStats {
                min: column[0],
                max: column[n - 1],
                mean,
                std: variance.sqrt(),
                quantiles: QUANTILES.map(|(q, _)| interpolate(&column, q)),
            }
        });
        Self::from_columns(columns, n as u64)
    }

    /// Computes the statistics of images, with colours in [0, 1].
    pub(crate) fn of_images(histograms: &[Histogram; 3], n_frames: u64) -> Self {
        Self::from_columns(histograms.iter().map(Histogram::stats), n_frames)
    }

    fn from_columns(columns: impl Iterator<Item = ComponentStats>, count: u64) -> Self {
        let columns: Vec<ComponentStats> = columns.collect();
        let each = |of: &dyn Fn(&ComponentStats) -> f64| columns.iter().map(of).collect();
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

/// The statistics of one component.
struct ComponentStats {
    min: f64,
    max: f64,
    mean: f64,
    std: f64,
    quantiles: [f64; 5],
}

/// The number of pixels per value of a colour channel.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(into = "Vec<u64>", try_from = "Vec<u64>")]
pub(crate) struct Histogram([u64; LEVELS]);

impl Default for Histogram {
    fn default() -> Self {
        Self([0; LEVELS])
    }
}

impl From<Histogram> for Vec<u64> {
    fn from(histogram: Histogram) -> Self {
        histogram.0.into()
    }
}

impl TryFrom<Vec<u64>> for Histogram {
    type Error = String;

    fn try_from(counts: Vec<u64>) -> Result<Self, String> {
        let expected =
            |counts: Vec<u64>| format!("a histogram has {} values, expected {LEVELS}", counts.len());
        counts.try_into().map(Self).map_err(expected)
    }
}

impl Histogram {
    /// Counts the pixels of an image `[height, width, 3]`.
    pub(crate) fn count(histograms: &mut [Self; 3], image: &[u8]) {
        for pixel in image.as_chunks::<3>().0 {
            histograms
                .iter_mut()
                .zip(pixel)
                .for_each(|(histogram, &level)| histogram.0[usize::from(level)] += 1);
        }
    }

    /// Adds the pixels of other images.
    pub(crate) fn add(histograms: &mut [Self; 3], others: &[Self; 3]) {
        for (histogram, other) in histograms.iter_mut().zip(others) {
            histogram.0.iter_mut().zip(&other.0).for_each(|(n, more)| *n += more);
        }
    }

    fn stats(&self) -> ComponentStats {
        let levels = || {
            self.0.iter().enumerate().filter(|(_, n)| **n > 0).map(|(level, &n)| (to_unit(level), n as f64))
        };
        let n: f64 = levels().map(|(_, n)| n).sum();
        let mean = levels().map(|(level, n)| level * n).sum::<f64>() / n;
        let variance = levels().map(|(level, n)| (level - mean).powi(2) * n).sum::<f64>() / n;
        let quantile = |q: f64| {
            let mut up_to = 0.0;
            let mut rest = levels().skip_while(|(_, n_here)| {
                up_to += n_here;
                up_to <= q * (n - 1.0)
            });
            rest.next().map_or(0.0, |(level, _)| level)
        };
        ComponentStats {
            min: levels().map(|(level, _)| level).fold(f64::INFINITY, f64::min),
            max: levels().map(|(level, _)| level).fold(f64::NEG_INFINITY, f64::max),
            mean,
            std: variance.sqrt(),
            quantiles: QUANTILES.map(|(q, _)| quantile(q)),
        }
    }
}

/// Maps an 8-bit colour value to [0, 1].
fn to_unit(level: usize) -> f64 {
    level as f64 / (LEVELS - 1) as f64
}

/// Returns the `q` quantile of sorted values, interpolated linearly.
fn interpolate(sorted: &[f64], q: f64) -> f64 {
    let at = q * (sorted.len() - 1) as f64;
    let (below, above) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    below + (above - below) * at.fract()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_interpolated() {
        assert_eq!(FeatureStats::of_values(&[3.0, 1.0, 2.0], 1).quantiles[2], [2.0]);
        assert_eq!(FeatureStats::of_values(&[0.0, 1.0], 1).quantiles[1], [0.1]);
    }

    #[test]
    fn image_statistics_are_in_unit_range() {
        let mut histograms: [Histogram; 3] = Default::default();
        Histogram::count(&mut histograms, &[0, 255, 51, 255, 255, 51, 0, 255, 102]);
        let stats = FeatureStats::of_images(&histograms, 1);
        assert_eq!((stats.min, stats.max), (vec![0.0, 1.0, 0.2], vec![1.0, 1.0, 0.4]));
        assert!(
            (stats.mean[0] - 1.0 / 3.0).abs() < 1e-12
                && (stats.std[0] - (2.0_f64 / 9.0).sqrt()).abs() < 1e-12
        );
        assert_eq!(stats.quantiles[2], [0.0, 1.0, 0.2]);
    }
}
