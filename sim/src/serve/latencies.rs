//! The distribution of the time between sending observations and receiving their answers.

use std::time::Duration;

use serde::{Deserialize, Serialize};

/// Number of buckets per factor of two, so that a bucket spans 4.4 %.
const PER_OCTAVE: f64 = 16.0;
/// Number of buckets: from 1 µs to 18 min.
const N_BUCKETS: usize = 480;

/// A histogram of latencies with logarithmic buckets. Empty histograms take no memory.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Latencies {
    counts: Vec<u64>,
}

impl Latencies {
    /// Adds the latency of a batch, once per env.
    pub fn record(&mut self, latency: Duration, n_envs: u64) {
        self.counts.resize(N_BUCKETS, 0);
        let microseconds = (latency.as_secs_f64() * 1e6).max(1.0);
        let bucket = (libm::log2(microseconds) * PER_OCTAVE) as usize;
        self.counts[bucket.min(N_BUCKETS - 1)] += n_envs;
    }

    /// Adds the counts of another histogram.
    pub fn add(&mut self, other: &Self) {
        self.counts.resize(self.counts.len().max(other.counts.len()), 0);
        for (ours, theirs) in self.counts.iter_mut().zip(&other.counts) {
            *ours += theirs;
        }
    }

    /// Returns the number of answers.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// Returns the latency in seconds that a fraction `q` of the queries does not exceed, to within 2.2 %;
    /// `None` without queries.
    #[must_use]
    pub fn quantile(&self, q: f64) -> Option<f64> {
        let rank = (q * self.count() as f64).ceil().max(1.0) as u64;
        let mut below = 0;
        let bucket = self.counts.iter().position(|count| {
            below += count;
            below >= rank
        })?;
        Some(1e-6 * libm::exp2((bucket as f64 + 0.5) / PER_OCTAVE))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_within_a_bucket() {
        let mut latencies = Latencies::default();
        assert_eq!(latencies.quantile(0.5), None);
        for ms in 1..=100 {
            latencies.record(Duration::from_millis(ms), 2);
        }
        let mut twice = latencies.clone();
        twice.add(&latencies);
        for histogram in [latencies, twice] {
            for (q, expected) in [(0.5, 0.050), (0.95, 0.095), (0.0, 0.001), (1.0, 0.1)] {
                let found = histogram.quantile(q).unwrap();
                assert!((found / expected - 1.0).abs() < 0.045, "{q}: {found}");
            }
        }
    }

    #[test]
    fn extreme_latencies_are_counted() {
        let mut latencies = Latencies::default();
        latencies.record(Duration::ZERO, 1);
        latencies.record(Duration::from_secs(1 << 40), 1);
        assert!(latencies.quantile(0.5).unwrap() < 1.1e-6);
        assert!(latencies.quantile(1.0).unwrap() > 1000.0);
    }
}
