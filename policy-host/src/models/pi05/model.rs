//! The network: images and tokens become the prefix, from which the expert denoises an action chunk.

use super::architecture::Pi05Architecture;
use super::checkpoint::names::Pi05Names;
use super::expert::{ActionExpert, TimePeriods};
use super::gemma::{GemmaModel, KeyValueCache};
use super::layers::LayerSource;
use super::siglip::SiglipVisionModel;
use crate::generated::{SPLITMIX_GAMMA, fnv1a64, splitmix64, unit};
use crate::nn::Precision;
use crate::nn::rotary::Rotary;
use crate::weights::{TensorFolder, WeightsError};

/// Images that pass through the vision tower together. It bounds the memory of the hidden layers.
const IMAGES_PER_BATCH: usize = 8;

/// Options of a network that its tensors do not determine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pi05Options {
    /// Precision of the large matrices. [`Precision::F32`] uses weights as stored, with f32 sums.
    pub precision: Precision,
    /// Number of Euler steps from noise to actions.
    pub n_steps: usize,
    /// Shortest and longest period of the time embedding.
    pub periods: (f64, f64),
    /// Maximum number of tokens of a prefix.
    pub max_prefix: usize,
}

/// Images of a batch, and the sequences of the samples.
#[derive(Clone, Copy, Debug)]
pub struct Pi05Input<'a> {
    /// Distinct images `[n, 3, side, side]` with values in [−1, 1].
    pub images: &'a [f32],
    /// Samples of the batch.
    pub samples: &'a [SampleTokens],
}

/// The prefix of one sample: images, then the prompt.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SampleTokens {
    /// Index of each image in [`Pi05Input::images`], in the network's order. Several samples may share one.
    pub images: Vec<usize>,
    /// Tokens of the prompt, without padding.
    pub prompt: Vec<u32>,
}

/// Intermediate results, for comparison with other implementations.
#[derive(Clone, Debug, Default)]
pub struct Pi05Trace {
    /// Tokens of all images, `[n, patches, width]`.
    pub image_embeddings: Vec<f32>,
    /// Tokens of all samples without padding, `[Σ lengths, width]`.
    pub prefix: Vec<f32>,
    /// Velocities `[n, horizon, action_width]` of each Euler step.
    pub velocities: Vec<Vec<f32>>,
}

/// A π0.5 network.
#[derive(Debug)]
pub struct Pi05Model {
    architecture: Pi05Architecture,
    vision_tower: SiglipVisionModel,
    language_model: GemmaModel,
    gemma_expert: ActionExpert,
    rotary: Rotary,
}

impl Pi05Model {
    /// Builds the network. The threads of the current rayon pool share the quantisation.
    ///
    /// # Errors
    /// If a tensor is missing.
    pub fn load(
        tensors: &TensorFolder,
        names: &Pi05Names,
        architecture: Pi05Architecture,
        options: Pi05Options,
    ) -> Result<Self, WeightsError> {
        let source = LayerSource { tensors, names, precision: options.precision };
        let (min, max) = options.periods;
        let periods = TimePeriods { min, max };
        let n_positions = options.max_prefix + architecture.horizon;
        Ok(Self {
            architecture,
            vision_tower: SiglipVisionModel::load(source, architecture.vision)?,
            language_model: GemmaModel::load(source, architecture.prefix)?,
            gemma_expert: ActionExpert::load(source, &architecture, &times(options.n_steps), periods)?,
            rotary: Rotary::new(architecture.prefix.head_dim, n_positions),
        })
    }

    /// Returns the sizes of the network.
    #[must_use]
    pub fn architecture(&self) -> &Pi05Architecture {
        &self.architecture
    }

    /// Computes a part of one layer, for a measurement of speed, and returns its floating-point operations.
    pub fn run_benchmark(&self) -> u64 {
        self.language_model.run_benchmark()
    }

    /// Denoises `actions [n, horizon, action_width]` in place, one chunk per sample. They hold the noise at
    /// first.
    ///
    /// # Panics
    /// If the lengths do not match.
    pub fn sample(&self, input: Pi05Input<'_>, actions: &mut [f32], mut trace: Option<&mut Pi05Trace>) {
        let Pi05Architecture { horizon, action_width, .. } = self.architecture;
        assert_eq!(actions.len(), input.samples.len() * horizon * action_width, "noise of every sample");
        let mut cache = self.prefix(input, trace.as_deref_mut());
        denoise(&self.gemma_expert, actions, &mut cache, &self.rotary, |_, velocity| {
            if let Some(trace) = trace.as_deref_mut() {
                trace.velocities.push(velocity.to_vec());
            }
        });
    }

    fn prefix(&self, input: Pi05Input<'_>, trace: Option<&mut Pi05Trace>) -> KeyValueCache {
        let Pi05Architecture { vision, prefix, horizon, .. } = self.architecture;
        let image_len = 3 * self.architecture.image_side().pow(2);
        let mut embeddings = Vec::new();
        for images in input.images.chunks(IMAGES_PER_BATCH * image_len) {
            embeddings.extend(self.vision_tower.forward(images));
        }
        let token_len = vision.n_patches * prefix.hidden_size;
        let lengths: Vec<usize> = input
            .samples
            .iter()
            .map(|sample| sample.images.len() * vision.n_patches + sample.prompt.len())
            .collect();
        let mut x = Vec::with_capacity(lengths.iter().sum::<usize>() * prefix.hidden_size);
        for sample in input.samples {
            for &image in &sample.images {
                x.extend_from_slice(&embeddings[image * token_len..][..token_len]);
            }
            for &token in &sample.prompt {
                let start = x.len();
                x.resize(start + prefix.hidden_size, 0.0);
                self.language_model.embed(token, &mut x[start..]);
            }
        }
        if let Some(trace) = trace {
            *trace = Pi05Trace { image_embeddings: embeddings, prefix: x.clone(), velocities: Vec::new() };
        }
        self.language_model.prefill(x, &lengths, horizon, &self.rotary)
    }
}

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
