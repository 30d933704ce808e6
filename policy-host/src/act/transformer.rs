//! The transformer of ACT: encoder layers over the memory tokens, decoder layers over the queries.
//!
//! Layers are post-norm (spec/eval.md §1.2). Letters: `T` tokens, `D` width, `F` inner width, `Q` queries. Everything is
//! done by a team of threads, each for rows or heads of its own.

use rayon::prelude::*;

use super::architecture::Architecture;
use super::team;
use crate::checkpoint::Weights;
use crate::nn::Precision;
use crate::nn::attention::Attended;
use crate::nn::linear::{Linear, relu};
use crate::nn::norm::LayerNorm;

/// Working memory.
#[derive(Clone, Debug)]
pub(super) struct TransformerScratch {
    n_members: usize,
    /// `[max(T, Q), D]`: tokens with their positions.
    placed: Vec<f32>,
    /// `[max(T, Q), D]`.
    queries: Vec<f32>,
    /// `[max(T, Q), D]`.
    keys: Vec<f32>,
    /// `[max(T, Q), D]`.
    values: Vec<f32>,
    /// `[n_heads, max(T, Q), D / n_heads]`.
    attended: Vec<f32>,
    /// `[n_members, max(T, Q)²]`.
    scores: Vec<f32>,
    /// `[max(T, Q), F]`.
    hidden: Vec<f32>,
    /// `[Q, D]`.
    decoded: Vec<f32>,
}

impl TransformerScratch {
    /// Working memory for one sample and a team of so many threads.
    #[must_use]
    pub(super) fn new(architecture: &Architecture, n_members: usize) -> Self {
        let (width, horizon) = (architecture.hidden_dim, architecture.horizon);
        let rows = architecture.max_tokens().max(horizon);
        let tokens = vec![0.0; rows * width];
        Self {
            n_members,
            placed: tokens.clone(),
            queries: tokens.clone(),
            keys: tokens.clone(),
            values: tokens.clone(),
            attended: tokens,
            scores: vec![0.0; n_members * rows * rows],
            hidden: vec![0.0; rows * architecture.dim_feedforward],
            decoded: vec![0.0; horizon * width],
        }
    }
}

/// The projections of a self- or cross-attention, the queries' divided by the root of the head's width.
#[derive(Clone, Debug)]
struct Attention {
    query: Linear,
    key: Linear,
    value: Linear,
    out: Linear,
    n_heads: usize,
}

impl Attention {
    /// From PyTorch's tensors, which hold queries above keys above values.
    fn new(architecture: &Architecture, weights: &Weights, precision: Precision, name: &str) -> Self {
        let width = architecture.hidden_dim;
        let part = |part: usize, factor: f32| {
            let scaled = |tensor: &str, len: usize| -> Vec<f32> {
                let numbers = weights.get(&format!("{name}.in_proj_{tensor}"));
                numbers[part * len..(part + 1) * len].iter().map(|x| x * factor).collect()
            };
            Linear::with_precision(&scaled("weight", width * width), &scaled("bias", width), precision)
        };
        let scale = 1.0 / ((width / architecture.n_heads) as f32).sqrt();
        Self {
            query: part(0, scale),
            key: part(1, 1.0),
            value: part(2, 1.0),
            out: linear(weights, precision, &format!("{name}.out_proj")),
            n_heads: architecture.n_heads,
        }
    }

    /// The heads of `n_queries` and `n_keys`, whose projections are in the working memory, into its `attended`.
    fn attend(&self, n_queries: usize, n_keys: usize, scratch: &mut TransformerScratch) {
        let TransformerScratch { n_members, queries, keys, values, attended: out, scores, .. } = scratch;
        let width = self.out.n_in();
        let (queries, len) = (&queries[..n_queries * width], n_keys * width);
        let attended =
            Attended { queries, keys: &keys[..len], values: &values[..len], width, n_heads: self.n_heads };
        let n_heads = team::share(self.n_heads, *n_members, 1);
        let out = out[..queries.len()].par_chunks_mut(n_heads * n_queries * attended.head_width());
        out.zip(scores.par_chunks_mut(n_queries * n_keys)).enumerate().for_each(|(member, (out, scores))| {
            attended.run(member * n_heads, out, scores);
        });
    }

    /// `x += out(attended)` for rows from `first_row` on, `attended` being `[n_heads, n_rows, D / n_heads]`.
    fn add_to(&self, attended: &[f32], n_rows: usize, first_row: usize, x: &mut [f32]) {
        let width = self.out.n_in();
        let (head_width, n_own) = (width / self.n_heads, x.len() / width);
        let block = |head: usize| &attended[(head * n_rows + first_row) * head_width..][..n_own * head_width];
        self.out.add_blocks_to(self.n_heads, block, x);
    }
}

/// The two linear layers with a ReLU between them.
#[derive(Clone, Debug)]
struct FeedForward {
    up: Linear,
    down: Linear,
}

impl FeedForward {
    fn new(weights: &Weights, precision: Precision, layer: &str) -> Self {
        Self {
            up: linear(weights, precision, &format!("{layer}.linear1")),
            down: linear(weights, precision, &format!("{layer}.linear2")),
        }
    }

    /// `x += down(relu(up(x)))`.
    fn add_to(&self, x: &mut [f32], hidden: &mut [f32]) {
        let hidden = &mut hidden[..x.len() / self.up.n_in() * self.up.n_out()];
        self.up.run(x, hidden);
        relu(hidden);
        self.down.add_to(hidden, x);
    }
}

/// What follows the heads in a layer of either kind.
#[derive(Clone, Debug)]
struct LayerRest {
    norm: LayerNorm,
    feed_forward: FeedForward,
    last_norm: LayerNorm,
}

impl LayerRest {
    /// With the layer's normalisations of these numbers.
    fn new(weights: &Weights, precision: Precision, layer: &str, norms: [usize; 2]) -> Self {
        let [norm, last_norm] = norms.map(|idx| layer_norm(weights, &format!("{layer}.norm{idx}")));
        Self { norm, feed_forward: FeedForward::new(weights, precision, layer), last_norm }
    }

    /// Adds what `attention` attended to, which is in the working memory, to `x`, and feeds that forward.
    fn run(&self, attention: &Attention, x: &mut [f32], scratch: &mut TransformerScratch) {
        let TransformerScratch { n_members, attended, hidden, .. } = scratch;
        let (width, inner) = (attention.out.n_in(), self.feed_forward.up.n_out());
        let n_rows = x.len() / width;
        let rows = team::rows(n_rows, *n_members);
        let bands = x.par_chunks_mut(rows * width).zip(hidden.par_chunks_mut(rows * inner));
        bands.enumerate().for_each(|(member, (x, hidden))| {
            attention.add_to(attended, n_rows, member * rows, x);
            self.norm.run(x);
            self.feed_forward.add_to(x, hidden);
            self.last_norm.run(x);
        });
    }
}

/// One encoder layer.
#[derive(Clone, Debug)]
pub(super) struct EncoderLayer {
    attention: Attention,
    rest: LayerRest,
}

impl EncoderLayer {
    /// From checked weights; `layer` as in `transformer.encoder.layers.0`.
    #[must_use]
    pub(super) fn new(
        architecture: &Architecture,
        weights: &Weights,
        precision: Precision,
        layer: &str,
    ) -> Self {
        Self {
            attention: Attention::new(architecture, weights, precision, &format!("{layer}.self_attn")),
            rest: LayerRest::new(weights, precision, layer, [1, 2]),
        }
    }

    /// Transforms the tokens `x [T, D]`, whose positions are `positions [T, D]`, in place.
    pub(super) fn run(&self, x: &mut [f32], positions: &[f32], scratch: &mut TransformerScratch) {
        let width = self.attention.out.n_in();
        let n_tokens = x.len() / width;
        project_all(&self.attention, x, positions, scratch);
        self.attention.attend(n_tokens, n_tokens, scratch);
        self.rest.run(&self.attention, x, scratch);
    }
}

/// Queries and keys of `x [T, D]` with its positions, values of `x` alone.
fn project_all(attention: &Attention, x: &[f32], positions: &[f32], scratch: &mut TransformerScratch) {
    project_memory(attention, x, positions, scratch);
    let len = team::rows(x.len() / attention.out.n_in(), scratch.n_members) * attention.out.n_in();
    let placed = scratch.placed[..x.len()].par_chunks(len);
    placed.zip(scratch.queries[..x.len()].par_chunks_mut(len)).for_each(|(placed, queries)| {
        attention.query.run(placed, queries);
    });
}

/// Keys of `memory [T, D]` with its positions, values of `memory` alone.
fn project_memory(
    attention: &Attention,
    memory: &[f32],
    positions: &[f32],
    scratch: &mut TransformerScratch,
) {
    let len = team::rows(memory.len() / attention.out.n_in(), scratch.n_members) * attention.out.n_in();
    let inputs = memory.par_chunks(len).zip(positions.par_chunks(len));
    let outputs = scratch.placed.par_chunks_mut(len).zip(scratch.keys.par_chunks_mut(len));
    let outputs = outputs.zip(scratch.values.par_chunks_mut(len));
    inputs.zip(outputs).for_each(|((memory, positions), ((placed, keys), values))| {
        let placed = &mut placed[..memory.len()];
        add(memory, positions, placed);
        attention.key.run(placed, &mut keys[..memory.len()]);
        attention.value.run(memory, &mut values[..memory.len()]);
    });
}

/// One decoder layer.
#[derive(Clone, Debug)]
struct DecoderLayer {
    own: Attention,
    norm1: LayerNorm,
    cross: Attention,
    rest: LayerRest,
}

impl DecoderLayer {
    fn new(architecture: &Architecture, weights: &Weights, precision: Precision, layer: &str) -> Self {
        Self {
            own: Attention::new(architecture, weights, precision, &format!("{layer}.self_attn")),
            norm1: layer_norm(weights, &format!("{layer}.norm1")),
            cross: Attention::new(architecture, weights, precision, &format!("{layer}.multihead_attn")),
            rest: LayerRest::new(weights, precision, layer, [2, 3]),
        }
    }

    /// Self-attention of the target `x [Q, D]`, in place, and then its queries to the memory.
    fn attend_to_target(&self, x: &mut [f32], query_positions: &[f32], scratch: &mut TransformerScratch) {
        let width = self.own.out.n_in();
        let n_queries = x.len() / width;
        project_all(&self.own, x, query_positions, scratch);
        self.own.attend(n_queries, n_queries, scratch);
        self.own.add_to(&scratch.attended, n_queries, 0, x);
        self.norm1.run(x);
        let placed = &mut scratch.placed[..x.len()];
        add(x, query_positions, placed);
        self.cross.query.run(placed, &mut scratch.queries[..x.len()]);
    }

    /// The rest of the layer, in place; the target's queries are in the working memory.
    fn attend_to_memory(
        &self,
        x: &mut [f32],
        memory: &[f32],
        positions: &[f32],
        scratch: &mut TransformerScratch,
    ) {
        let width = self.cross.out.n_in();
        let (n_queries, n_tokens) = (x.len() / width, memory.len() / width);
        project_memory(&self.cross, memory, positions, scratch);
        self.cross.attend(n_queries, n_tokens, scratch);
        self.rest.run(&self.cross, x, scratch);
    }
}

/// The decoder: its layers, the final normalisation, and the action head.
///
/// The target starts at zero, so the first layer up to the cross-attention's queries is the same for every input: it is
/// computed once here.
#[derive(Clone, Debug)]
pub(super) struct Decoder {
    layers: Vec<DecoderLayer>,
    /// `[Q, D]`.
    query_positions: Vec<f32>,
    /// `[Q, D]`: the target after the first layer's self-attention and its normalisation.
    target: Vec<f32>,
    /// `[Q, D]`: the first cross-attention's queries.
    queries: Vec<f32>,
    norm: LayerNorm,
    action_head: Linear,
}

impl Decoder {
    /// From checked weights.
    #[must_use]
    pub(super) fn new(architecture: &Architecture, weights: &Weights, precision: Precision) -> Self {
        let layer = |idx| {
            DecoderLayer::new(architecture, weights, precision, &format!("transformer.decoder.layers.{idx}"))
        };
        let layers: Vec<_> = (0..architecture.dec_layers).map(layer).collect();
        let query_positions = weights.get("query_embed.weight").to_vec();
        let mut target = vec![0.0; query_positions.len()];
        let mut scratch = TransformerScratch::new(architecture, 1);
        layers[0].attend_to_target(&mut target, &query_positions, &mut scratch);
        Self {
            layers,
            queries: scratch.queries[..query_positions.len()].to_vec(),
            query_positions,
            target,
            norm: layer_norm(weights, "transformer.decoder.norm"),
            action_head: linear(weights, Precision::F32, "action_head"),
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
        let mut x = std::mem::take(&mut scratch.decoded);
        x.copy_from_slice(&self.target);
        scratch.queries[..x.len()].copy_from_slice(&self.queries);
        for (idx, layer) in self.layers.iter().enumerate() {
            if idx > 0 {
                layer.attend_to_target(&mut x, &self.query_positions, scratch);
            }
            layer.attend_to_memory(&mut x, memory, positions, scratch);
        }
        self.norm.run(&mut x);
        self.action_head.run(&x, actions);
        scratch.decoded = x;
    }
}

/// The linear layer of that name.
pub(super) fn linear(weights: &Weights, precision: Precision, name: &str) -> Linear {
    let [weight, bias] = ["weight", "bias"].map(|part| weights.get(&format!("{name}.{part}")));
    Linear::with_precision(weight, bias, precision)
}

/// The layer normalisation of that name.
pub(super) fn layer_norm(weights: &Weights, name: &str) -> LayerNorm {
    LayerNorm::new(weights.get(&format!("{name}.weight")), weights.get(&format!("{name}.bias")))
}

fn add(x: &[f32], y: &[f32], out: &mut [f32]) {
    assert_eq!((x.len(), y.len()), (out.len(), out.len()), "terms of a sum");
    out.iter_mut().zip(x).zip(y).for_each(|((out, x), y)| *out = x + y);
}
