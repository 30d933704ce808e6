//! The ACT network: maps images, state and instruction to an action chunk.

use std::f64::consts::TAU;
use std::path::Path;

use ipc_types::ImageSize;
use rayon::prelude::*;

use super::architecture::{Architecture, Normalisation, TokenProjection, features};
use super::backbone::{Backbone, BackboneScratch};
use super::checkpoint::ActCheckpoint;
use super::image::Image;
use super::leading::LeadingTokens;
use super::team;
use super::transformer::{Decoder, EncoderLayer, TransformerScratch, linear};
use crate::formats::CheckpointError;
use crate::nn::Precision;
use crate::nn::conv::ConvScratch;
use crate::nn::linear::Linear;
use crate::weights::StateDict;

/// An ACT network. It is immutable and shared by all threads.
#[derive(Debug)]
pub struct ActModel {
    architecture: Architecture,
    normalisation: Normalisation,
    /// Backbone and `input_proj` of its features, or `None` for a network without images.
    vision: Option<(Backbone, Linear)>,
    leading: LeadingTokens,
    /// Position embeddings `[max t, d]` of all tokens, instruction included.
    positions: Vec<f32>,
    /// Position embeddings `[max t − 1, d]` without the instruction token.
    positions_without_instruction: Vec<f32>,
    encoder: Vec<EncoderLayer>,
    decoder: Decoder,
}

/// Working memory for a group of samples and the team of threads that computes them.
#[derive(Debug)]
pub struct ActScratch {
    backbone: BackboneScratch,
    members: Vec<ConvScratch>,
    transformer: TransformerScratch,
    /// Image features `[n_samples, n_image_tokens, c]`.
    features: Vec<f32>,
    /// Encoder tokens `[max t, d]`.
    tokens: Vec<f32>,
    /// Normalised state `[state_dim]`.
    state: Vec<f32>,
}

/// Network input for one sample, apart from its images.
#[derive(Clone, Copy, Debug)]
pub struct ActInput<'a> {
    /// Raw state `[state_dim]`; empty for a network without state input.
    pub state: &'a [f32],
    /// Token `[d]` of the instruction ([`ActModel::instruction_token`]), if there is one.
    pub instruction_token: Option<&'a [f32]>,
}

impl ActModel {
    /// Loads the checkpoint in `folder` in f32, for images of these sizes.
    ///
    /// # Errors
    /// The first file or tensor that is missing, unexpected or damaged.
    pub fn load(folder: &Path, sizes: &[ImageSize]) -> Result<Self, CheckpointError> {
        let mut checkpoint = ActCheckpoint::open(folder)?;
        let state_dict = checkpoint.state_dict()?;
        let (architecture, normalisation) = (checkpoint.architecture(), checkpoint.normalisation());
        Ok(Self::new(architecture.clone(), normalisation.clone(), &state_dict, Precision::F32, sizes))
    }

    /// Builds the network for images of these sizes. [`Precision::Int8`] applies to the backbone's residual
    /// blocks, the image projection and the transformer's linear layers. The stem, the other input
    /// projections, the attention products and the action head stay in f32.
    ///
    /// # Panics
    /// If `state_dict` lacks a tensor of `architecture`, or one has a different shape.
    #[must_use]
    pub fn new(
        architecture: Architecture,
        normalisation: Normalisation,
        state_dict: &StateDict,
        precision: Precision,
        sizes: &[ImageSize],
    ) -> Self {
        let vision = (!architecture.cameras.is_empty()).then(|| {
            let backbone = Backbone::new(&architecture, &normalisation, state_dict, precision, sizes);
            (backbone, linear(state_dict, precision, "input_proj"))
        });
        let encoder = (0..architecture.enc_layers).map(|layer| {
            let name = format!("transformer.encoder.layers.{layer}");
            EncoderLayer::new(&architecture, state_dict, precision, &name)
        });
        let [positions, positions_without_instruction] = positions(&architecture, state_dict);
        Self {
            vision,
            leading: LeadingTokens::new(&architecture, &normalisation, state_dict),
            positions,
            positions_without_instruction,
            encoder: encoder.collect(),
            decoder: Decoder::new(&architecture, state_dict, precision),
            architecture,
            normalisation,
        }
    }

    /// Returns the projections to the tokens before those of the images.
    pub(crate) fn leading(&self) -> &LeadingTokens {
        &self.leading
    }

    /// Returns the architecture.
    #[must_use]
    pub fn architecture(&self) -> &Architecture {
        &self.architecture
    }

    /// Allocates working memory for up to `n_samples` samples, computed by a team of `n_members` threads.
    #[must_use]
    pub fn scratch(&self, n_samples: usize, n_members: usize) -> ActScratch {
        let n_members = n_members.max(1);
        let mut members = vec![ConvScratch::default(); n_members];
        let (architecture, vision) = (&self.architecture, self.vision.as_ref());
        let n_features = n_samples * architecture.n_image_tokens() * architecture.backbone.n_features();
        ActScratch {
            backbone: vision
                .map(|(backbone, _)| backbone.scratch(n_samples, &mut members))
                .unwrap_or_default(),
            members,
            transformer: TransformerScratch::new(architecture, n_members),
            features: vec![0.0; n_features],
            tokens: vec![0.0; architecture.max_tokens() * architecture.hidden_dim],
            state: vec![0.0; architecture.state_dim.unwrap_or(0)],
        }
    }

    /// Returns the token `[d]` of an instruction embedding, or `None` for a network without instruction
    /// input.
    ///
    /// # Panics
    /// If the embedding has a different dimension.
    #[must_use]
    pub fn instruction_token(&self, embedding: &[f32]) -> Option<Vec<f32>> {
        self.leading.instruction_token(embedding)
    }

    /// Computes the features of the images `image(sample_idx, camera)` of `n_samples` samples, for later
    /// calls of [`forward`](Self::forward). Batching samples only saves time: neither their number nor the
    /// number of threads (one per member of `scratch`, from the current pool) changes a bit.
    ///
    /// # Panics
    /// If `scratch` was allocated for fewer samples, or an image has the wrong size.
    pub fn encode_images<'a>(
        &self,
        n_samples: usize,
        image: impl Fn(usize, usize) -> Image<'a>,
        scratch: &mut ActScratch,
    ) {
        if let Some((backbone, _)) = &self.vision {
            let len = self.architecture.n_image_tokens() * self.architecture.backbone.n_features();
            let features = &mut scratch.features[..n_samples * len];
            backbone.forward(n_samples, image, &mut scratch.backbone, &mut scratch.members, features);
        }
    }

    /// Computes the action chunk `actions [horizon, action_dim]`, in the units of the environment, from the
    /// image features of sample `sample_idx` ([`encode_images`](Self::encode_images)) and `input`. With
    /// fewer rows, `actions` are the first rows of the same chunk, for less work.
    ///
    /// # Panics
    /// If a slice has the wrong length.
    pub fn forward(
        &self,
        sample_idx: usize,
        input: ActInput<'_>,
        scratch: &mut ActScratch,
        actions: &mut [f32],
    ) {
        let width = self.architecture.hidden_dim;
        let instruction = input.instruction_token.unwrap_or_default();
        let positions =
            if instruction.is_empty() { &self.positions_without_instruction } else { &self.positions };
        let tokens = &mut scratch.tokens[..positions.len()];

        scratch.state.copy_from_slice(input.state);
        let image_tokens = self.leading.write(&mut scratch.state, instruction, tokens);
        if let Some((_, input_proj)) = &self.vision {
            let len = image_tokens.len() / width * input_proj.in_features();
            let rows = team::rows_per_member(image_tokens.len() / width, scratch.members.len());
            let features =
                scratch.features[sample_idx * len..][..len].par_chunks(rows * input_proj.in_features());
            image_tokens.par_chunks_mut(rows * width).zip(features).for_each(|(tokens, features)| {
                input_proj.forward(features, tokens);
            });
        }

        for layer in &self.encoder {
            layer.forward(tokens, positions, &mut scratch.transformer);
        }
        self.decoder.forward(tokens, positions, &mut scratch.transformer, actions);
        if let Some(norm) = &self.normalisation.action {
            norm.restore(actions);
        }
    }
}

/// Returns the position embeddings of all tokens, and of all but the instruction token: learned ones, zero
/// for an instruction token without a learned one, and the sinusoidal encoding for image tokens, equal for
/// cameras of one size.
pub(crate) fn positions(architecture: &Architecture, state_dict: &StateDict) -> [Vec<f32>; 2] {
    let width = architecture.hidden_dim;
    let learned = state_dict.get("additional_pos_embed.weight");
    let images: Vec<f32> =
        architecture.cameras.iter().flat_map(|size| sine_encoding(features(*size), width)).collect();
    let n_always = 1 + usize::from(architecture.state_dim.is_some());
    let always = &learned[..n_always * width];
    let zero_position = match architecture.instruction.map(|input| input.projection) {
        Some(TokenProjection::Mlp) => vec![0.0; width],
        Some(TokenProjection::Linear) | None => Vec::new(),
    };
    [[learned, &zero_position, &images].concat(), [always, &images].concat()]
}

/// Base of the geometric progression of wavelengths.
const TEMPERATURE: f64 = 10_000.0;

/// Returns the encoding `[h, w, d] f32` of one camera's feature map. The first half of a token encodes its
/// row, the second half its column.
#[must_use]
pub(crate) fn sine_encoding(map: ImageSize, hidden_dim: usize) -> Vec<f32> {
    let half = hidden_dim / 2;
    let mut encoding = vec![0.0; map.n_pixels() * hidden_dim];
    for (token, out) in encoding.chunks_exact_mut(hidden_dim).enumerate() {
        let coordinates = [(token / map.width, map.height), (token % map.width, map.width)];
        for (part, (coordinate, side)) in coordinates.into_iter().enumerate() {
            let angle = (coordinate + 1) as f64 / (side as f64 + 1e-6) * TAU;
            for (idx, x) in out[part * half..(part + 1) * half].iter_mut().enumerate() {
                let phase = angle / libm::pow(TEMPERATURE, (idx / 2 * 2) as f64 / half as f64);
                *x = if idx % 2 == 0 { libm::sin(phase) } else { libm::cos(phase) } as f32;
            }
        }
    }
    encoding
}
