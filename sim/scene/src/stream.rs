//! Named random streams: the only source of randomness in an episode.
//!
//! A stream is determined by the episode seed and a name such as `"cube/pose"`. Adding, removing or reading a
//! stream never changes the values of another, so a perturbation affects only the values that it owns.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use xxhash_rust::xxh3::xxh3_64_with_seed;

use crate::Range;

/// A random stream of one episode.
#[derive(Clone, Debug)]
pub struct Stream(ChaCha8Rng);

impl Stream {
    /// Creates the stream `name` of the episode with seed `episode_seed`.
    #[must_use]
    pub fn new(episode_seed: u64, name: &str) -> Self {
        let mut seed = [0_u8; 32];
        for (word, bytes) in (0_u64..).zip(seed.chunks_exact_mut(8)) {
            bytes.copy_from_slice(&derive(derive(episode_seed, name), &word.to_string()).to_le_bytes());
        }
        Self(ChaCha8Rng::from_seed(seed))
    }

    /// Draws a value uniformly from [0, 1); it is a multiple of 2⁻⁵³.
    pub fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// Draws a value uniformly from `range`.
    pub fn uniform(&mut self, range: Range) -> f64 {
        range.lerp(self.unit())
    }

    /// Chooses an element of `all` with equal probabilities.
    ///
    /// # Panics
    /// If `all` is empty.
    pub fn choose<'a, T>(&mut self, all: &'a [T]) -> &'a T {
        &all[(self.unit() * all.len() as f64) as usize]
    }

    /// Draws a value from the standard normal distribution by the Box–Muller transform.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * libm::log(1.0 - self.unit())).sqrt();
        radius * libm::cos(core::f64::consts::TAU * self.unit())
    }
}

/// Returns the seed of an episode. It depends on suite seed, task and index only, so that all perturbations
/// and policies run the same episodes (twins). It is less than 2⁶³ so that it fits an SQLite integer.
#[must_use]
pub fn episode_seed(suite_seed: u64, task: &str, episode_idx: u32) -> u64 {
    derive(derive(suite_seed, task), &format!("episode/{episode_idx}")) >> 1
}

/// Returns the seed of an attempt at placing the bodies of an episode; the first uses the episode's own.
pub(crate) fn placement_seed(episode_seed: u64, attempt: usize) -> u64 {
    if attempt == 0 { episode_seed } else { derive(episode_seed, &format!("placement/{attempt}")) }
}

/// Returns the seed for a policy that draws random numbers.
#[must_use]
pub fn policy_seed(episode_seed: u64) -> u64 {
    derive(episode_seed, "policy")
}

fn derive(seed: u64, name: &str) -> u64 {
    xxh3_64_with_seed(name.as_bytes(), seed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stream_depends_on_seed_and_name_only() {
        let draw = |seed, name| Stream::new(seed, name).unit();
        assert_eq!(draw(7, "cube/pose"), draw(7, "cube/pose"));
        assert_ne!(draw(7, "cube/pose"), draw(8, "cube/pose"));
        assert_ne!(draw(7, "cube/pose"), draw(7, "cube/color"));
    }

    #[test]
    fn draws_have_expected_moments() {
        let mut stream = Stream::new(1, "moments");
        let n = 20_000;
        let uniform: f64 = (0..n).map(|_| stream.uniform(Range::new(-1.0, 3.0))).sum::<f64>() / f64::from(n);
        assert!((uniform - 1.0).abs() < 0.03, "mean {uniform}");
        let normals: Vec<f64> = (0..n).map(|_| stream.normal()).collect();
        let mean = normals.iter().sum::<f64>() / f64::from(n);
        let variance = normals.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / f64::from(n);
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.05, "mean {mean}, variance {variance}");
    }

    #[test]
    fn episode_seeds_are_distinct_and_fit_sqlite() {
        let mut seeds: Vec<u64> = (0..1000).map(|i| episode_seed(0, "RaiseCube", i)).collect();
        assert!(seeds.iter().all(|s| i64::try_from(*s).is_ok()));
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), 1000);
    }
}
