//! The network: images, state and an instruction in, an action chunk out.

use std::path::Path;

use rayon::prelude::*;

use super::architecture::{Architecture, ImageSize, Projection};
use super::backbone::{Backbone, TrunkScratch};
use super::image::Image;
use super::normalise::Normalisation;
use super::position::sine_encoding;
use super::team;
use super::transformer::{Decoder, EncoderLayer, TransformerScratch, layer_norm, linear};
use crate::checkpoint::{Checkpoint, CheckpointError, Weights};
use crate::nn::Precision;
use crate::nn::conv::ConvScratch;
use crate::nn::linear::{Linear, relu};
use crate::nn::norm::LayerNorm;

/// The network, ready to run: fixed once made, shared by all threads.
#[derive(Debug)]
pub struct ActModel {
    architecture: Architecture,
    normalisation: Normalisation,
    /// The image network and the projection of its features, for a network that sees images.
    vision: Option<(Backbone, Linear)>,
    state_projection: Option<Linear>,
    instruction_projection: Option<InstructionProjection>,
    /// `[D]`: the token of a zero latent.
    latent_token: Vec<f32>,
    /// `[max T, D]`: positions of all tokens, instruction included.
    positions: Vec<f32>,
    /// `[max T − 1, D]`: positions without an instruction's token.
    positions_without_instruction: Vec<f32>,
    encoder: Vec<EncoderLayer>,
    decoder: Decoder,
}

/// From an instruction's embedding to its token.
#[derive(Debug)]
struct InstructionProjection {
    /// Each with a ReLU between.
    inner: Vec<(Linear, LayerNorm)>,
    out: Linear,
}

/// Working memory for some samples and the team of threads that computes them.
#[derive(Debug)]
pub struct ActScratch {
    trunk: TrunkScratch,
    members: Vec<ConvScratch>,
    transformer: TransformerScratch,
    /// `[n_samples, n_image_tokens, n_features]`.
    features: Vec<f32>,
    /// `[max T, D]`.
    tokens: Vec<f32>,
    /// `[state_dim]`, normalised.
    state: Vec<f32>,
}

/// What the network sees of one env.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// `[state_dim]`; empty for a network that sees no state.
    pub state: &'a [f32],
    /// The token of its instruction ([`ActModel::instruction_token`]), if it has one.
    pub instruction_token: Option<&'a [f32]>,
}

impl ActModel {
    /// Loads the checkpoint in `folder`, for images of these sizes.
    ///
    /// # Errors
    /// The first thing in the folder that is missing, unexpected or damaged.
    pub fn load(folder: &Path, sizes: &[ImageSize]) -> Result<Self, CheckpointError> {
        let mut checkpoint = Checkpoint::open(folder)?;
        let weights = checkpoint.weights()?;
        let (architecture, normalisation) = (checkpoint.architecture(), checkpoint.normalisation());
        Ok(Self::new(architecture.clone(), normalisation.clone(), &weights, Precision::F32, sizes))
    }

    /// Builds the network for images of these sizes. In eight bits are the blocks of the image network and the transformer;
    /// its attentions, the first convolution and what maps tokens to actions are not.
    ///
    /// # Panics
    /// If `weights` lack a tensor of `architecture` or have another shape.
    #[must_use]
    pub fn new(
        architecture: Architecture,
        normalisation: Normalisation,
        weights: &Weights,
        precision: Precision,
        sizes: &[ImageSize],
    ) -> Self {
        let exact = |name: &str| linear(weights, Precision::F32, name);
        let instruction_projection = architecture.instruction.map(|input| match input.projection {
            Projection::Linear => {
                InstructionProjection { inner: Vec::new(), out: exact("input_proj_env_state") }
            }
            Projection::Mlp => InstructionProjection {
                inner: [("lang_proj.0", "lang_proj.2"), ("lang_proj.3", "lang_proj.5")]
                    .map(|(dense, norm)| (exact(dense), layer_norm(weights, norm)))
                    .into(),
                out: exact("lang_proj.6"),
            },
        });
        let vision = (!architecture.cameras.is_empty()).then(|| {
            let backbone = Backbone::new(&architecture, &normalisation, weights, precision, sizes);
            (backbone, linear(weights, precision, "input_proj"))
        });
        let encoder = (0..architecture.enc_layers).map(|layer| {
            let name = format!("transformer.encoder.layers.{layer}");
            EncoderLayer::new(&architecture, weights, precision, &name)
        });
        let [positions, positions_without_instruction] = positions(&architecture, weights);
        Self {
            vision,
            state_projection: architecture.state_dim.map(|_| exact("input_proj_robot_state")),
            instruction_projection,
            latent_token: weights.get("latent_out_proj.bias").to_vec(),
            positions,
            positions_without_instruction,
            encoder: encoder.collect(),
            decoder: Decoder::new(&architecture, weights, precision),
            architecture,
            normalisation,
        }
    }

    /// Its shape.
    #[must_use]
    pub fn architecture(&self) -> &Architecture {
        &self.architecture
    }

    /// Working memory for up to `n_samples` at a time, computed by a team of `n_members` threads.
    #[must_use]
    pub fn scratch(&self, n_samples: usize, n_members: usize) -> ActScratch {
        let n_members = n_members.max(1);
        let mut members = vec![ConvScratch::default(); n_members];
        let (architecture, vision) = (&self.architecture, self.vision.as_ref());
        let n_features = n_samples * architecture.n_image_tokens() * architecture.backbone.n_features();
        ActScratch {
            trunk: vision.map(|(backbone, _)| backbone.scratch(n_samples, &mut members)).unwrap_or_default(),
            members,
            transformer: TransformerScratch::new(architecture, n_members),
            features: vec![0.0; n_features],
            tokens: vec![0.0; architecture.max_tokens() * architecture.hidden_dim],
            state: vec![0.0; architecture.state_dim.unwrap_or(0)],
        }
    }

    /// The token `[D]` of an instruction's embedding, or `None` for a network that sees no instruction.
    ///
    /// # Panics
    /// If the embedding has another width.
    #[must_use]
    pub fn instruction_token(&self, embedding: &[f32]) -> Option<Vec<f32>> {
        let projection = self.instruction_projection.as_ref()?;
        let mut x = embedding.to_vec();
        if let Some(affine) = &self.normalisation.instruction {
            affine.normalise(&mut x);
        }
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

    /// Computes the features of the images of `n_samples`, `image(sample_idx, camera)`, for [`run`](Self::run). Samples are
    /// taken together only because that is faster; their number changes no bit, and neither does that of the threads, as many
    /// of the current pool as the scratch has members.
    ///
    /// # Panics
    /// If the scratch is for fewer samples, or an image does not have its size.
    pub fn look<'a>(
        &self,
        n_samples: usize,
        image: impl Fn(usize, usize) -> Image<'a>,
        scratch: &mut ActScratch,
    ) {
        if let Some((backbone, _)) = &self.vision {
            let len = self.architecture.n_image_tokens() * self.architecture.backbone.n_features();
            let features = &mut scratch.features[..n_samples * len];
            backbone.run(n_samples, image, &mut scratch.trunk, &mut scratch.members, features);
        }
    }

    /// The action chunk `[horizon, action_dim]`, in the units of the environment, from the images last looked at as
    /// `sample_idx`, the raw state, and the instruction's token if it has one.
    ///
    /// # Panics
    /// If a slice does not have its size.
    pub fn run(&self, sample_idx: usize, input: Input<'_>, scratch: &mut ActScratch, actions: &mut [f32]) {
        let width = self.architecture.hidden_dim;
        let instruction = input.instruction_token.unwrap_or_default();
        let positions =
            if instruction.is_empty() { &self.positions_without_instruction } else { &self.positions };
        let tokens = &mut scratch.tokens[..positions.len()];

        let (latent, rest) = tokens.split_at_mut(width);
        latent.copy_from_slice(&self.latent_token);
        let (state_token, rest) = rest.split_at_mut(self.state_projection.as_ref().map_or(0, Linear::n_out));
        if let Some(projection) = &self.state_projection {
            scratch.state.copy_from_slice(input.state);
            if let Some(affine) = &self.normalisation.state {
                affine.normalise(&mut scratch.state);
            }
            projection.run(&scratch.state, state_token);
        }
        let (instruction_token, image_tokens) = rest.split_at_mut(instruction.len());
        instruction_token.copy_from_slice(instruction);
        if let Some((_, projection)) = &self.vision {
            let len = image_tokens.len() / width * projection.n_in();
            let rows = team::rows(image_tokens.len() / width, scratch.members.len());
            let features = scratch.features[sample_idx * len..][..len].par_chunks(rows * projection.n_in());
            image_tokens.par_chunks_mut(rows * width).zip(features).for_each(|(tokens, features)| {
                projection.run(features, tokens);
            });
        }

        for layer in &self.encoder {
            layer.run(tokens, positions, &mut scratch.transformer);
        }
        self.decoder.run(tokens, positions, &mut scratch.transformer, actions);
        if let Some(affine) = &self.normalisation.action {
            affine.restore(actions);
        }
    }
}

/// Positions of all tokens, and of all but the instruction's: learned ones, zero for an instruction's token without, and
/// sines for the cameras' features, the same for each camera of one size.
fn positions(architecture: &Architecture, weights: &Weights) -> [Vec<f32>; 2] {
    let width = architecture.hidden_dim;
    let learned = weights.get("additional_pos_embed.weight");
    let images: Vec<f32> =
        architecture.cameras.iter().flat_map(|size| sine_encoding(size.features(), width)).collect();
    let n_always = 1 + usize::from(architecture.state_dim.is_some());
    let always = &learned[..n_always * width];
    let unplaced = match architecture.instruction.map(|input| input.projection) {
        Some(Projection::Mlp) => vec![0.0; width],
        Some(Projection::Linear) | None => Vec::new(),
    };
    [[learned, &unplaced, &images].concat(), [always, &images].concat()]
}
