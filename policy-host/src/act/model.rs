//! The network of one morphology: images, state and an instruction in, an action chunk out.

use std::path::Path;

use super::backbone::{ResNet18, TrunkScratch};
use super::checkpoint::{Checkpoint, CheckpointError, Weights};
use super::config::ActConfig;
use super::image::Image;
use super::position::sine_encoding;
use super::transformer::{Decoder, EncoderLayer, TransformerScratch, layer_norm, linear};
use crate::nn::linear::{Linear, relu};
use crate::nn::norm::LayerNorm;

/// Smallest standard deviation that normalisation divides by (spec/eval.md §1.3).
const MIN_STD: f32 = 0.01;

/// The network, ready to run: fixed once made, shared by all threads.
#[derive(Debug)]
pub struct ActModel {
    config: ActConfig,
    backbone: ResNet18,
    image_projection: Linear,
    state_projection: Linear,
    language: Option<LanguageProjection>,
    /// `[D]`: the token of a zero latent.
    latent_token: Vec<f32>,
    /// `[T, D]`: positions of all tokens, language included (zero) if the network knows it.
    positions: Vec<f32>,
    /// `[T, D]`: positions without a language token.
    positions_without_language: Vec<f32>,
    encoder: Vec<EncoderLayer>,
    decoder: Decoder,
    statistics: Option<Statistics>,
}

/// `(Linear, ReLU, LayerNorm) × 2, Linear` (spec/eval.md §1.2).
#[derive(Debug)]
struct LanguageProjection {
    inner: [(Linear, LayerNorm); 2],
    out: Linear,
}

/// Means and standard deviations of a checkpoint trained on normalised numbers.
#[derive(Debug)]
struct Statistics {
    state_mean: Vec<f32>,
    state_std: Vec<f32>,
    action_mean: Vec<f32>,
    action_std: Vec<f32>,
}

/// Working memory of one thread.
#[derive(Clone, Debug)]
pub struct ActScratch {
    trunk: TrunkScratch,
    transformer: TransformerScratch,
    /// `[max T, D]`.
    tokens: Vec<f32>,
    /// `[state_dim]`, normalised.
    state: Vec<f32>,
}

impl ActModel {
    /// Loads the checkpoint in `folder`.
    ///
    /// # Errors
    /// The first thing in the folder that is missing, unexpected or damaged.
    pub fn load(folder: &Path) -> Result<Self, CheckpointError> {
        let mut checkpoint = Checkpoint::open(folder)?;
        let weights = checkpoint.weights()?;
        Ok(Self::new(checkpoint.config().clone(), &weights))
    }

    /// Builds the network.
    ///
    /// # Panics
    /// If `weights` lack a live tensor of `config` or have another shape.
    #[must_use]
    pub fn new(config: ActConfig, weights: &Weights) -> Self {
        let width = config.hidden_dim;
        let language = config.language.map(|_| LanguageProjection {
            inner: [("lang_proj.0", "lang_proj.2"), ("lang_proj.3", "lang_proj.5")]
                .map(|(dense, norm)| (linear(weights, dense), layer_norm(weights, norm))),
            out: linear(weights, "lang_proj.6"),
        });
        let learned = weights.get("additional_pos_embed.weight");
        let zeros = vec![0.0; if language.is_some() { width } else { 0 }];
        let image = image_positions(&config);
        let encoder = (0..config.enc_layers)
            .map(|layer| EncoderLayer::new(&config, weights, &format!("transformer.encoder.layers.{layer}")));
        Self {
            backbone: ResNet18::new(&config, weights),
            image_projection: linear(weights, "input_proj"),
            state_projection: linear(weights, "input_proj_robot_state"),
            language,
            latent_token: weights.get("latent_out_proj.bias").to_vec(),
            positions: [learned, &zeros, &image].concat(),
            positions_without_language: [learned, &image].concat(),
            encoder: encoder.collect(),
            decoder: Decoder::new(&config, weights),
            statistics: weights.statistics().map(Statistics::new),
            config,
        }
    }

    /// The configuration.
    #[must_use]
    pub fn config(&self) -> &ActConfig {
        &self.config
    }

    /// Numbers in a feature of the backbone.
    #[must_use]
    pub fn n_features(&self) -> usize {
        self.backbone.n_features()
    }

    /// Working memory for one thread.
    #[must_use]
    pub fn scratch(&self) -> ActScratch {
        ActScratch {
            trunk: self.backbone.scratch(self.config.n_cameras),
            transformer: TransformerScratch::new(&self.config),
            tokens: vec![0.0; self.config.max_tokens() * self.config.hidden_dim],
            state: vec![0.0; self.config.state_dim],
        }
    }

    /// The token of an instruction's embedding `[language.dim]`, or `None` for a network without language.
    ///
    /// # Panics
    /// If the embedding has another width.
    #[must_use]
    pub fn language_token(&self, embedding: &[f32]) -> Option<Vec<f32>> {
        let projection = self.language.as_ref()?;
        let mut x = embedding.to_vec();
        for (dense, norm) in &projection.inner {
            let mut y = vec![0.0; dense.n_out()];
            dense.run(&x, &mut y);
            relu(&mut y);
            norm.run(&mut y);
            x = y;
        }
        let mut token = vec![0.0; projection.out.n_out()];
        projection.out.run(&x, &mut token);
        Some(token)
    }

    /// Features of up to `n_cameras` images: `take(image_idx, row, col, features [n_features])` for each of the 7×7
    /// places of each image. An image's features do not depend on the others in the call.
    pub fn trunk<'a>(
        &self,
        images: impl Iterator<Item = Image<'a>>,
        scratch: &mut ActScratch,
        take: impl FnMut(usize, usize, usize, &[f32]),
    ) {
        self.backbone.run(images, &mut scratch.trunk, take);
    }

    /// Where a camera's feature belongs among the image tokens: cameras are laid side by side, then read row by row.
    #[must_use]
    pub fn image_token(&self, camera: usize, row: usize, col: usize) -> usize {
        let side = ActConfig::FEATURE_SIDE;
        row * self.config.n_cameras * side + camera * side + col
    }

    /// The action chunk `[num_queries, action_dim]` from `features [n_image_tokens, n_features]` in the order of
    /// [`image_token`](Self::image_token), the raw state, and the instruction's token if it has one.
    ///
    /// # Panics
    /// If a slice does not have its size.
    pub fn head(
        &self,
        features: &[f32],
        state: &[f32],
        language_token: Option<&[f32]>,
        scratch: &mut ActScratch,
        actions: &mut [f32],
    ) {
        let width = self.config.hidden_dim;
        let language_token = language_token.unwrap_or_default();
        let n_leading = 2 + language_token.len() / width;
        let tokens = &mut scratch.tokens[..(n_leading + self.config.n_image_tokens()) * width];
        let (leading, image_tokens) = tokens.split_at_mut(n_leading * width);
        let (latent, rest) = leading.split_at_mut(width);
        let (state_token, language) = rest.split_at_mut(width);
        latent.copy_from_slice(&self.latent_token);
        scratch.state.copy_from_slice(state);
        if let Some(statistics) = &self.statistics {
            statistics.normalise(&mut scratch.state);
        }
        self.state_projection.run(&scratch.state, state_token);
        language.copy_from_slice(language_token);
        let positions = if language.is_empty() { &self.positions_without_language } else { &self.positions };
        self.image_projection.run(features, image_tokens);

        for layer in &self.encoder {
            layer.run(tokens, positions, &mut scratch.transformer);
        }
        self.decoder.run(tokens, positions, &mut scratch.transformer, actions);
        if let Some(statistics) = &self.statistics {
            statistics.restore(actions);
        }
    }
}

impl Statistics {
    fn new([state_mean, state_std, action_mean, action_std]: [&[f32]; 4]) -> Self {
        Self {
            state_mean: state_mean.to_vec(),
            state_std: state_std.to_vec(),
            action_mean: action_mean.to_vec(),
            action_std: action_std.to_vec(),
        }
    }

    fn normalise(&self, state: &mut [f32]) {
        for ((x, mean), std) in state.iter_mut().zip(&self.state_mean).zip(&self.state_std) {
            *x = (*x - mean) / std.max(MIN_STD);
        }
    }

    fn restore(&self, actions: &mut [f32]) {
        for row in actions.chunks_exact_mut(self.action_mean.len()) {
            for ((x, mean), std) in row.iter_mut().zip(&self.action_mean).zip(&self.action_std) {
                *x = *x * std.max(MIN_STD) + mean;
            }
        }
    }
}

/// `[n_image_tokens, D]`: the same encoding for every camera.
fn image_positions(config: &ActConfig) -> Vec<f32> {
    let (side, width) = (ActConfig::FEATURE_SIDE, config.hidden_dim);
    let one = sine_encoding(width);
    let rows = one.chunks_exact(side * width);
    rows.flat_map(|row| std::iter::repeat_n(row, config.n_cameras)).flatten().copied().collect()
}
