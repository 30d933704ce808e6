//! CLIP's text tower: a pre-norm transformer with causal attention (Radford et al., Learning transferable
//! visual models from natural language supervision, 2021).
//!
//! Letters in shapes: `t` tokens, `d` model width, `e` embedding dimension.

use super::tensors::{FINAL_NORM, HEAD_WIDTH, LAYERS, POSITIONS, PROJECTION, TOKENS, TowerShape};
use crate::nn::attention::Qkv;
use crate::nn::gelu::quick_gelu;
use crate::nn::linear::Linear;
use crate::nn::norm::LayerNorm;
use crate::weights::StateDict;

/// The text tower.
#[derive(Debug)]
pub(crate) struct TextTower {
    /// Token embeddings `[vocabulary, d]`.
    token_embedding: Vec<f32>,
    /// Position embeddings `[MAX_TOKENS, d]`.
    position_embedding: Vec<f32>,
    layers: Vec<TowerLayer>,
    final_norm: LayerNorm,
    projection: Linear,
}

#[derive(Debug)]
struct TowerLayer {
    norm1: LayerNorm,
    /// Scaled by `1 / √head_width`.
    query: Linear,
    key: Linear,
    value: Linear,
    out: Linear,
    norm2: LayerNorm,
    fc1: Linear,
    fc2: Linear,
}

impl TextTower {
    /// Builds the tower from a checked state dict.
    pub(crate) fn new(shape: TowerShape, state_dict: &StateDict) -> Self {
        Self {
            token_embedding: state_dict.get(TOKENS).to_vec(),
            position_embedding: state_dict.get(POSITIONS).to_vec(),
            layers: (0..shape.n_layers)
                .map(|idx| TowerLayer::new(state_dict, &format!("{LAYERS}.{idx}")))
                .collect(),
            final_norm: layer_norm(state_dict, FINAL_NORM),
            projection: Linear::new(state_dict.get(PROJECTION), &vec![0.0; shape.dim]),
        }
    }

    /// Returns the embedding `[e]` of a token sequence: the projection of its last token, the only one that
    /// attends to all others.
    pub(crate) fn forward(&self, tokens: &[u16]) -> Vec<f32> {
        let width = self.projection.in_features();
        let row = |token: u16| &self.token_embedding[usize::from(token) * width..][..width];
        let embedded = tokens.iter().flat_map(|&token| row(token)).zip(&self.position_embedding);
        let mut x: Vec<f32> = embedded.map(|(token, position)| token + position).collect();
        for layer in &self.layers {
            layer.forward(&mut x);
        }
        let mut last = x.split_off(x.len() - width);
        self.final_norm.forward(&mut last);
        project(&self.projection, &last)
    }
}

impl TowerLayer {
    fn new(state_dict: &StateDict, name: &str) -> Self {
        let linear = |part: &str, factor: f32| {
            let scaled = |tensor: &str| -> Vec<f32> {
                state_dict.get(&format!("{name}.{part}.{tensor}")).iter().map(|x| x * factor).collect()
            };
            Linear::new(&scaled("weight"), &scaled("bias"))
        };
        Self {
            norm1: layer_norm(state_dict, &format!("{name}.layer_norm1")),
            query: linear("self_attn.q_proj", 1.0 / (HEAD_WIDTH as f32).sqrt()),
            key: linear("self_attn.k_proj", 1.0),
            value: linear("self_attn.v_proj", 1.0),
            out: linear("self_attn.out_proj", 1.0),
            norm2: layer_norm(state_dict, &format!("{name}.layer_norm2")),
            fc1: linear("mlp.fc1", 1.0),
            fc2: linear("mlp.fc2", 1.0),
        }
    }

    /// Applies the layer to `x [t, d]` in place.
    fn forward(&self, x: &mut [f32]) {
        let width = self.out.in_features();
        let (n_tokens, n_heads) = (x.len() / width, width / HEAD_WIDTH);
        let mut normed = x.to_vec();
        self.norm1.forward(&mut normed);
        let (queries, keys, values) =
            (project(&self.query, &normed), project(&self.key, &normed), project(&self.value, &normed));
        let qkv = Qkv { queries: &queries, keys: &keys, values: &values, width, n_heads };
        let mut heads = vec![0.0; x.len()];
        qkv.causal_attention(0, &mut heads, &mut vec![0.0; n_tokens * n_tokens]);
        let head = |idx: usize| &heads[idx * n_tokens * HEAD_WIDTH..][..n_tokens * HEAD_WIDTH];
        self.out.forward_add_blocks(n_heads, head, x);

        normed.copy_from_slice(x);
        self.norm2.forward(&mut normed);
        let mut hidden = project(&self.fc1, &normed);
        quick_gelu(&mut hidden);
        self.fc2.forward_add(&hidden, x);
    }
}

fn layer_norm(state_dict: &StateDict, name: &str) -> LayerNorm {
    LayerNorm::new(state_dict.get(&format!("{name}.weight")), state_dict.get(&format!("{name}.bias")))
}

fn project(linear: &Linear, x: &[f32]) -> Vec<f32> {
    let mut out = vec![0.0; x.len() / linear.in_features() * linear.out_features()];
    linear.forward(x, &mut out);
    out
}
