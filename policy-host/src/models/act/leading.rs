//! The tokens before those of the images: latent, state and instruction.

use super::architecture::{Architecture, InstructionInput, Normalisation, TokenProjection};
use super::transformer::{layer_norm, linear};
use crate::formats::scaling::ShiftScale;
use crate::nn::Precision;
use crate::nn::linear::{Linear, relu};
use crate::nn::norm::LayerNorm;
use crate::text::TextEncoder;
use crate::weights::StateDict;

/// The projections of state and instruction to tokens, and the token of the latent.
#[derive(Debug)]
pub(crate) struct LeadingTokens {
    /// Token `[d]` of a zero latent.
    latent: Vec<f32>,
    state: Option<(Linear, Option<ShiftScale>)>,
    instruction: Option<InstructionProjection>,
    input: Option<InstructionInput>,
}

/// Projection of an instruction embedding to its token.
#[derive(Debug)]
struct InstructionProjection {
    normalisation: Option<ShiftScale>,
    /// Hidden layers, each `Linear`, `ReLU`, `LayerNorm`.
    inner: Vec<(Linear, LayerNorm)>,
    out: Linear,
}

impl LeadingTokens {
    /// Builds the projections from a checked state dict.
    pub(crate) fn new(
        architecture: &Architecture,
        normalisation: &Normalisation,
        state_dict: &StateDict,
    ) -> Self {
        let linear_f32 = |name: &str| linear(state_dict, Precision::F32, name);
        let instruction = architecture.instruction.map(|input| {
            let (inner, out) = match input.projection {
                TokenProjection::Linear => (Vec::new(), linear_f32("input_proj_env_state")),
                TokenProjection::Mlp => (
                    [("lang_proj.0", "lang_proj.2"), ("lang_proj.3", "lang_proj.5")]
                        .map(|(dense, norm)| (linear_f32(dense), layer_norm(state_dict, norm)))
                        .into(),
                    linear_f32("lang_proj.6"),
                ),
            };
            InstructionProjection { normalisation: normalisation.instruction.clone(), inner, out }
        });
        let state = architecture
            .state_dim
            .map(|_| (linear_f32("input_proj_robot_state"), normalisation.state.clone()));
        let latent = state_dict.get("latent_out_proj.bias").to_vec();
        Self { latent, state, instruction, input: architecture.instruction }
    }

    /// Returns the instruction input of the network, if it has one.
    pub(crate) fn instruction_input(&self) -> Option<InstructionInput> {
        self.input
    }

    /// Returns the token `[d]` of an instruction embedding, or `None` for a network without instruction
    /// input.
    ///
    /// # Panics
    /// If the embedding has a different dimension.
    pub(crate) fn instruction_token(&self, embedding: &[f32]) -> Option<Vec<f32>> {
        let projection = self.instruction.as_ref()?;
        let mut x = embedding.to_vec();
        if let Some(norm) = &projection.normalisation {
            norm.normalise(&mut x);
        }
        for (dense, norm) in &projection.inner {
            let mut y = vec![0.0; dense.out_features()];
            dense.forward(&x, &mut y);
            relu(&mut y);
            norm.forward(&mut y);
            x = y;
        }
        let mut token = vec![0.0; projection.out.out_features()];
        projection.out.forward(&x, &mut token);
        Some(token)
    }

    /// Writes the tokens to the start of `tokens` and returns the rest. `state` is normalised in place;
    /// `instruction` is empty or a token.
    pub(crate) fn write<'a>(
        &self,
        state: &mut [f32],
        instruction: &[f32],
        tokens: &'a mut [f32],
    ) -> &'a mut [f32] {
        let (latent, rest) = tokens.split_at_mut(self.latent.len());
        latent.copy_from_slice(&self.latent);
        let (state_token, rest) =
            rest.split_at_mut(self.state.as_ref().map_or(0, |(layer, _)| layer.out_features()));
        if let Some((projection, normalisation)) = &self.state {
            if let Some(normalisation) = normalisation {
                normalisation.normalise(state);
            }
            projection.forward(state, state_token);
        }
        let (instruction_token, rest) = rest.split_at_mut(instruction.len());
        instruction_token.copy_from_slice(instruction);
        rest
    }
}

/// Maximum number of cached instructions. The oldest entry is evicted first.
const CAPACITY: usize = 256;

/// Cache from instruction to token `[d]`.
#[derive(Debug)]
pub(crate) struct TokenCache {
    encoder: Option<TextEncoder>,
    entries: Vec<(String, Vec<f32>)>,
    /// Index of the entry to overwrite next.
    next: usize,
}

impl TokenCache {
    /// Creates an empty cache. `encoder` is `None` for a network without instruction input.
    pub(crate) fn new(encoder: Option<TextEncoder>) -> Self {
        Self { encoder, entries: Vec::new(), next: 0 }
    }

    /// Returns the token of an instruction. Returns `None` if the network has no instruction input, or if the
    /// instruction is empty and the benchmark's network omits the token (docs/benchmark.md, "Policies and
    /// evaluation").
    pub(crate) fn get(&mut self, instruction: &str, leading: &LeadingTokens) -> Option<&[f32]> {
        let input = leading.instruction_input()?;
        if instruction.is_empty() && input.projection == TokenProjection::Mlp {
            return None;
        }
        let cached = self.entries.iter().position(|(key, _)| key == instruction);
        let idx = match cached {
            Some(idx) => idx,
            None => {
                let embedding = self.encoder.as_ref()?.encode(instruction);
                self.insert((instruction.to_owned(), leading.instruction_token(&embedding)?))
            }
        };
        Some(&self.entries[idx].1)
    }

    fn insert(&mut self, entry: (String, Vec<f32>)) -> usize {
        let idx = self.next;
        self.next = (idx + 1) % CAPACITY;
        if idx < self.entries.len() {
            self.entries[idx] = entry;
        } else {
            self.entries.push(entry);
        }
        idx
    }
}
