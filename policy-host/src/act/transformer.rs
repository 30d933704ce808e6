//! The transformer of ACT: encoder layers over the memory tokens, and the one decoder layer that reaches the output.
//!
//! Layers are post-norm (spec/eval.md §1.2). Letters: `T` tokens, `D` width, `F` inner width, `Q` queries.

use std::ops::Range;

use super::checkpoint::Weights;
use super::config::ActConfig;
use crate::nn::attention::{Columns, attend};
use crate::nn::linear::{Linear, relu};
use crate::nn::norm::LayerNorm;

/// Working memory.
#[derive(Clone, Debug)]
pub(super) struct TransformerScratch {
    /// `[T, D]`: tokens with their positions, later the attention's result.
    mixed: Vec<f32>,
    /// `[T, 2·D]`: queries and keys.
    queries_keys: Vec<f32>,
    /// `[T, D]`.
    values: Vec<f32>,
    /// `[max(T, Q), F]`.
    hidden: Vec<f32>,
    /// `[max(T, Q), T]`.
    scores: Vec<f32>,
    /// `[Q, D]`.
    decoded: Vec<f32>,
}

impl TransformerScratch {
    /// Working memory for one sample.
    #[must_use]
    pub(super) fn new(config: &ActConfig) -> Self {
        let (tokens, width, queries) = (config.max_tokens(), config.hidden_dim, config.num_queries);
        let rows = tokens.max(queries);
        Self {
            mixed: vec![0.0; rows * width],
            queries_keys: vec![0.0; tokens * 2 * width],
            values: vec![0.0; tokens * width],
            hidden: vec![0.0; rows * config.dim_feedforward],
            scores: vec![0.0; rows * tokens],
            decoded: vec![0.0; queries * width],
        }
    }
}

/// The projections of a self- or cross-attention as PyTorch stores them, queries above keys above values, the queries'
/// divided by the root of the head's width.
struct Projections {
    /// `[3·D, D]`.
    matrix: Vec<f32>,
    /// `[3·D]`.
    bias: Vec<f32>,
    out: Linear,
}

impl Projections {
    fn new(config: &ActConfig, weights: &Weights, name: &str) -> Self {
        let part = |part: &str| weights.get(&format!("{name}.in_proj_{part}")).to_vec();
        let (mut matrix, mut bias) = (part("weight"), part("bias"));
        let scale = 1.0 / ((config.hidden_dim / config.nheads) as f32).sqrt();
        for queries in [&mut matrix[..config.hidden_dim * config.hidden_dim], &mut bias[..config.hidden_dim]]
        {
            queries.iter_mut().for_each(|x| *x *= scale);
        }
        Self { matrix, bias, out: linear(weights, &format!("{name}.out_proj")) }
    }

    /// Queries, keys and values are parts 0, 1 and 2.
    fn parts(&self, parts: Range<usize>) -> Linear {
        let width = self.bias.len() / 3;
        let rows = parts.start * width..parts.end * width;
        Linear::new(&self.matrix[rows.start * width..rows.end * width], &self.bias[rows])
    }
}

/// The two linear layers with a ReLU between them.
#[derive(Clone, Debug)]
struct FeedForward {
    up: Linear,
    down: Linear,
}

impl FeedForward {
    fn new(weights: &Weights, layer: &str) -> Self {
        Self {
            up: linear(weights, &format!("{layer}.linear1")),
            down: linear(weights, &format!("{layer}.linear2")),
        }
    }

    /// `x += down(relu(up(x)))`.
    fn add_to(&self, x: &mut [f32], hidden: &mut [f32]) {
        let n_rows = x.len() / self.up.n_in();
        let hidden = &mut hidden[..n_rows * self.up.n_out()];
        self.up.run(x, hidden);
        relu(hidden);
        self.down.add_to(hidden, x);
    }
}

/// One encoder layer.
#[derive(Clone, Debug)]
pub(super) struct EncoderLayer {
    /// Queries, then keys: both see the positions.
    query_key: Linear,
    value: Linear,
    out: Linear,
    norm1: LayerNorm,
    feed_forward: FeedForward,
    norm2: LayerNorm,
    n_heads: usize,
}

impl EncoderLayer {
    /// From checked weights; `layer` as in `transformer.encoder.layers.0`.
    #[must_use]
    pub(super) fn new(config: &ActConfig, weights: &Weights, layer: &str) -> Self {
        let projections = Projections::new(config, weights, &format!("{layer}.self_attn"));
        Self {
            query_key: projections.parts(0..2),
            value: projections.parts(2..3),
            out: projections.out,
            norm1: layer_norm(weights, &format!("{layer}.norm1")),
            feed_forward: FeedForward::new(weights, layer),
            norm2: layer_norm(weights, &format!("{layer}.norm2")),
            n_heads: config.nheads,
        }
    }

    /// Transforms the tokens `x [T, D]`, whose positions are `positions [T, D]`, in place.
    pub(super) fn run(&self, x: &mut [f32], positions: &[f32], scratch: &mut TransformerScratch) {
        let width = self.value.n_out();
        let n_tokens = x.len() / width;
        let mixed = &mut scratch.mixed[..x.len()];
        let queries_keys = &mut scratch.queries_keys[..2 * x.len()];
        let values = &mut scratch.values[..x.len()];
        add(x, positions, mixed);
        self.query_key.run(mixed, queries_keys);
        self.value.run(x, values);
        let queries = Columns { data: queries_keys, stride: 2 * width };
        let keys = Columns { data: &queries_keys[width..], stride: 2 * width };
        let values = Columns { data: values, stride: width };
        attend((queries, n_tokens), (keys, values, n_tokens), self.n_heads, mixed, &mut scratch.scores);
        self.out.add_to(mixed, x);
        self.norm1.run(x);
        self.feed_forward.add_to(x, &mut scratch.hidden);
        self.norm2.run(x);
    }
}

/// The decoder: its first layer, the final normalisation, and the action head.
///
/// The target starts at zero, so the self-attention's values are its bias and the layer up to the cross-attention's
/// queries is the same for every input: both are computed once here.
#[derive(Clone, Debug)]
pub(super) struct Decoder {
    /// `[Q, D]`: the target after self-attention and its normalisation.
    target: Vec<f32>,
    /// `[Q, D]`: the cross-attention's queries.
    queries: Vec<f32>,
    key: Linear,
    value: Linear,
    out: Linear,
    norm2: LayerNorm,
    feed_forward: FeedForward,
    norm3: LayerNorm,
    final_norm: LayerNorm,
    action_head: Linear,
    n_heads: usize,
}

impl Decoder {
    /// From checked weights.
    #[must_use]
    pub(super) fn new(config: &ActConfig, weights: &Weights) -> Self {
        let layer = "transformer.decoder.layers.0";
        let own = Projections::new(config, weights, &format!("{layer}.self_attn"));
        let cross = Projections::new(config, weights, &format!("{layer}.multihead_attn"));
        let width = config.hidden_dim;
        let len = config.num_queries * width;

        let (mut attended, mut target) = (vec![0.0; len], vec![0.0; len]);
        own.parts(2..3).run(&vec![0.0; len], &mut attended);
        own.out.run(&attended, &mut target);
        layer_norm(weights, &format!("{layer}.norm1")).run(&mut target);
        let (mut placed, mut queries) = (vec![0.0; len], vec![0.0; len]);
        add(&target, weights.get("query_embed.weight"), &mut placed);
        cross.parts(0..1).run(&placed, &mut queries);

        Self {
            target,
            queries,
            key: cross.parts(1..2),
            value: cross.parts(2..3),
            out: cross.out,
            norm2: layer_norm(weights, &format!("{layer}.norm2")),
            feed_forward: FeedForward::new(weights, layer),
            norm3: layer_norm(weights, &format!("{layer}.norm3")),
            final_norm: layer_norm(weights, "transformer.decoder.norm"),
            action_head: linear(weights, "action_head"),
            n_heads: config.nheads,
        }
    }

    /// `actions [Q, action_dim]` from the encoded tokens `memory [T, D]` and their positions.
    pub(super) fn run(
        &self,
        memory: &[f32],
        positions: &[f32],
        scratch: &mut TransformerScratch,
        actions: &mut [f32],
    ) {
        let width = self.value.n_out();
        let (n_tokens, n_queries) = (memory.len() / width, self.queries.len() / width);
        let keys = &mut scratch.queries_keys[..memory.len()];
        let values = &mut scratch.values[..memory.len()];
        add(memory, positions, &mut scratch.mixed[..memory.len()]);
        self.key.run(&scratch.mixed[..memory.len()], keys);
        self.value.run(memory, values);
        let queries = Columns { data: &self.queries, stride: width };
        let [keys, values] = [&*keys, &*values].map(|data| Columns { data, stride: width });
        let mixed = &mut scratch.mixed[..self.queries.len()];
        attend((queries, n_queries), (keys, values, n_tokens), self.n_heads, mixed, &mut scratch.scores);
        let x = &mut scratch.decoded;
        x.copy_from_slice(&self.target);
        self.out.add_to(mixed, x);
        self.norm2.run(x);
        self.feed_forward.add_to(x, &mut scratch.hidden);
        self.norm3.run(x);
        self.final_norm.run(x);
        self.action_head.run(x, actions);
    }
}

/// The linear layer of that name.
pub(super) fn linear(weights: &Weights, name: &str) -> Linear {
    Linear::new(weights.get(&format!("{name}.weight")), weights.get(&format!("{name}.bias")))
}

/// The layer normalisation of that name.
pub(super) fn layer_norm(weights: &Weights, name: &str) -> LayerNorm {
    LayerNorm::new(weights.get(&format!("{name}.weight")), weights.get(&format!("{name}.bias")))
}

fn add(x: &[f32], y: &[f32], out: &mut [f32]) {
    assert_eq!((x.len(), y.len()), (out.len(), out.len()), "terms of a sum");
    out.iter_mut().zip(x).zip(y).for_each(|((out, x), y)| *out = x + y);
}
