//! The network: images and tokens become the prefix, from which the expert denoises an action chunk.

use super::architecture::{Pi05Architecture, Pi05Names};
use super::expert::{ActionExpert, TimePeriods};
use super::gemma::{KeyValueCache, LanguageModel};
use super::sampler::{denoise, times};
use super::siglip::VisionTower;
use super::weights::LayerSource;
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
    vision: VisionTower,
    language: LanguageModel,
    expert: ActionExpert,
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
            vision: VisionTower::load(source, architecture.vision)?,
            language: LanguageModel::load(source, architecture.prefix)?,
            expert: ActionExpert::load(source, &architecture, &times(options.n_steps), periods)?,
            rotary: Rotary::new(architecture.prefix.head_width, n_positions),
        })
    }

    /// Returns the sizes of the network.
    #[must_use]
    pub fn architecture(&self) -> &Pi05Architecture {
        &self.architecture
    }

    /// Computes a part of one layer, to be timed, and returns the number of floating-point operations.
    pub fn compute_sample(&self) -> u64 {
        self.language.compute_sample()
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
        denoise(&self.expert, actions, &mut cache, &self.rotary, |_, velocity| {
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
            embeddings.extend(self.vision.encode(images));
        }
        let token_len = vision.n_patches * prefix.width;
        let lengths: Vec<usize> = input
            .samples
            .iter()
            .map(|sample| sample.images.len() * vision.n_patches + sample.prompt.len())
            .collect();
        let mut x = Vec::with_capacity(lengths.iter().sum::<usize>() * prefix.width);
        for sample in input.samples {
            for &image in &sample.images {
                x.extend_from_slice(&embeddings[image * token_len..][..token_len]);
            }
            for &token in &sample.prompt {
                let start = x.len();
                x.resize(start + prefix.width, 0.0);
                self.language.embed(token, &mut x[start..]);
            }
        }
        if let Some(trace) = trace {
            *trace = Pi05Trace { image_embeddings: embeddings, prefix: x.clone(), velocities: Vec::new() };
        }
        self.language.read(x, &lengths, horizon, &self.rotary)
    }
}
