//! The text transformer of CLIP: pre-norm layers in which a token sees those before it (Radford et al., Learning
//! transferable visual models from natural language supervision, 2021).
//!
//! Letters: `T` tokens, `D` width, `E` width of the embedding.

use super::tensors::{FINAL_NORM, HEAD_WIDTH, LAYERS, POSITIONS, PROJECTION, TOKENS, TowerShape};
use crate::checkpoint::Weights;
use crate::nn::attention::Attended;
use crate::nn::gelu::quick_gelu;
use crate::nn::linear::Linear;
use crate::nn::norm::LayerNorm;

/// The network.
#[derive(Debug)]
pub(super) struct Tower {
    /// `[vocabulary, D]`.
    tokens: Vec<f32>,
    /// `[most tokens, D]`.
    positions: Vec<f32>,
    layers: Vec<Layer>,
    norm: LayerNorm,
    projection: Linear,
}

#[derive(Debug)]
struct Layer {
    attention_norm: LayerNorm,
    /// Divided by the root of the head's width.
    query: Linear,
    key: Linear,
    value: Linear,
    out: Linear,
    hidden_norm: LayerNorm,
    widen: Linear,
    narrow: Linear,
}

impl Tower {
    /// From checked weights.
    pub(super) fn new(shape: TowerShape, weights: &Weights) -> Self {
        Self {
            tokens: weights.get(TOKENS).to_vec(),
            positions: weights.get(POSITIONS).to_vec(),
            layers: (0..shape.n_layers).map(|idx| Layer::new(weights, &format!("{LAYERS}.{idx}"))).collect(),
            norm: norm(weights, FINAL_NORM),
            projection: Linear::new(weights.get(PROJECTION), &vec![0.0; shape.dim]),
        }
    }

    /// The embedding `[E]` of a text: the projected last of its tokens, which is the only one that has seen all others.
    pub(super) fn run(&self, tokens: &[u16]) -> Vec<f32> {
        let width = self.projection.n_in();
        let row = |token: u16| &self.tokens[usize::from(token) * width..][..width];
        let placed = tokens.iter().flat_map(|&token| row(token)).zip(&self.positions);
        let mut x: Vec<f32> = placed.map(|(token, position)| token + position).collect();
        for layer in &self.layers {
            layer.run(&mut x);
        }
        let mut last = x.split_off(x.len() - width);
        self.norm.run(&mut last);
        run(&self.projection, &last)
    }
}

impl Layer {
    fn new(weights: &Weights, name: &str) -> Self {
        let linear = |part: &str, factor: f32| {
            let scaled = |tensor: &str| -> Vec<f32> {
                weights.get(&format!("{name}.{part}.{tensor}")).iter().map(|x| x * factor).collect()
            };
            Linear::new(&scaled("weight"), &scaled("bias"))
        };
        Self {
            attention_norm: norm(weights, &format!("{name}.layer_norm1")),
            query: linear("self_attn.q_proj", 1.0 / (HEAD_WIDTH as f32).sqrt()),
            key: linear("self_attn.k_proj", 1.0),
            value: linear("self_attn.v_proj", 1.0),
            out: linear("self_attn.out_proj", 1.0),
            hidden_norm: norm(weights, &format!("{name}.layer_norm2")),
            widen: linear("mlp.fc1", 1.0),
            narrow: linear("mlp.fc2", 1.0),
        }
    }

    /// `x [T, D]` in place.
    fn run(&self, x: &mut [f32]) {
        let width = self.out.n_in();
        let (n_tokens, n_heads) = (x.len() / width, width / HEAD_WIDTH);
        let mut seen = x.to_vec();
        self.attention_norm.run(&mut seen);
        let (queries, keys, values) =
            (run(&self.query, &seen), run(&self.key, &seen), run(&self.value, &seen));
        let attended = Attended { queries: &queries, keys: &keys, values: &values, width, n_heads };
        let mut heads = vec![0.0; x.len()];
        attended.run_causal(0, &mut heads, &mut vec![0.0; n_tokens * n_tokens]);
        let head = |idx: usize| &heads[idx * n_tokens * HEAD_WIDTH..][..n_tokens * HEAD_WIDTH];
        self.out.add_blocks_to(n_heads, head, x);

        seen.copy_from_slice(x);
        self.hidden_norm.run(&mut seen);
        let mut hidden = run(&self.widen, &seen);
        quick_gelu(&mut hidden);
        self.narrow.add_to(&hidden, x);
    }
}

fn norm(weights: &Weights, name: &str) -> LayerNorm {
    LayerNorm::new(weights.get(&format!("{name}.weight")), weights.get(&format!("{name}.bias")))
}

fn run(linear: &Linear, x: &[f32]) -> Vec<f32> {
    let mut out = vec![0.0; x.len() / linear.n_in() * linear.n_out()];
    linear.run(x, &mut out);
    out
}
