//! Flow matching: an action chunk is the end of a path that starts at noise and follows the velocities of the
//! expert from time 1 to time 0 in equal Euler steps.

use super::expert::ActionExpert;
use super::gemma::KeyValueCache;
use crate::generated::{SPLITMIX_GAMMA, fnv1a64, splitmix64, unit};
use crate::nn::rotary::Rotary;

/// Name of the random stream from which noise is drawn.
const NOISE: &str = "pi05.noise";

/// Returns the times of `n_steps` Euler steps, 1 first.
pub(crate) fn times(n_steps: usize) -> Vec<f32> {
    let step = -1.0 / n_steps as f64;
    (0..n_steps).map(|idx| (1.0 + idx as f64 * step) as f32).collect()
}

/// Denoises `actions [n, horizon, action_width]` in place, for the sequences in the cache. Calls
/// `observe(step, velocities)` after each step.
pub(crate) fn denoise(
    expert: &ActionExpert,
    actions: &mut [f32],
    cache: &mut KeyValueCache,
    rotary: &Rotary,
    mut observe: impl FnMut(usize, &[f32]),
) {
    let step = (-1.0 / expert.n_times() as f64) as f32;
    for time in 0..expert.n_times() {
        let velocity = expert.velocity(actions, time, cache, rotary);
        actions.iter_mut().zip(&velocity).for_each(|(action, velocity)| *action += step * velocity);
        observe(time, &velocity);
    }
}

/// Draws the noise of one query from the normal distribution: a function of the episode's seed and the query
/// alone.
pub(crate) fn draw_noise(policy_seed: u64, query: u32, out: &mut [f32]) {
    let episode = splitmix64(policy_seed ^ fnv1a64(NOISE));
    let stream = splitmix64(episode.wrapping_add(u64::from(query).wrapping_mul(SPLITMIX_GAMMA)));
    for (pair, out) in out.chunks_mut(2).enumerate() {
        // Box and Muller's transform; `1 − unit` lies in (0, 1].
        let uniform = |idx: usize| f64::from(unit(stream, 2 * pair + idx));
        let radius = (-2.0 * libm::log(1.0 - uniform(0))).sqrt();
        let angle = 2.0 * std::f64::consts::PI * uniform(1);
        for (x, value) in out.iter_mut().zip([libm::cos(angle), libm::sin(angle)]) {
            *x = (radius * value) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_normal_and_differs_by_query() {
        let mut first = vec![0.0; 20_000];
        let mut second = first.clone();
        draw_noise(7, 0, &mut first);
        draw_noise(7, 1, &mut second);
        let mean = |x: &[f32]| x.iter().sum::<f32>() / x.len() as f32;
        let squares: Vec<f32> = first.iter().map(|x| x * x).collect();
        let products: Vec<f32> = first.iter().zip(&second).map(|(a, b)| a * b).collect();
        assert!(mean(&first).abs() < 0.02, "mean {}", mean(&first));
        assert!((mean(&squares) - 1.0).abs() < 0.03, "variance {}", mean(&squares));
        assert!(mean(&products).abs() < 0.02, "correlation {}", mean(&products));
    }
}
