//! The transformer of ACT: encoder layers over the memory tokens, decoder layers over the queries.
//!
//! Layers are post-norm (spec/eval.md §1.2). Letters: `T` tokens, `D` width, `F` inner width, `Q` queries. Everything is
//! done by a team of threads, each for rows or heads of its own.

use rayon::prelude::*;

use super::architecture::Architecture;
use super::team;
use crate::checkpoint::Weights;
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
    /// `[max(T, Q) and a bit, F]`.
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
    fn new(architecture: &Architecture, weights: &Weights, name: &str) -> Self {
        let width = architecture.hidden_dim;
        let part = |part: usize, factor: f32| {
            let scaled = |tensor: &str, len: usize| -> Vec<f32> {
                let numbers = weights.get(&format!("{name}.in_proj_{tensor}"));
                numbers[part * len..(part + 1) * len].iter().map(|x| x * factor).collect()
            };
            Linear::new(&scaled("weight", width * width), &scaled("bias", width))
        };
        let scale = 1.0 / ((width / architecture.n_heads) as f32).sqrt();
        Self {
            query: part(0, scale),
            key: part(1, 1.0),
            value: part(2, 1.0),
            out: linear(weights, &format!("{name}.out_proj")),
            n_heads: architecture.n_heads,
        }
    }

    /// Heads of `n_queries` and `n_keys` already in `queries`, `keys` and `values` of the working memory, into `attended`.
    fn attend(&self, queries: &[f32], n_keys: usize, scratch: &mut AttentionScratch<'_>) {
        let width = self.out.n_in();
        let len = n_keys * width;
        let (keys, values) = (&scratch.keys[..len], &scratch.values[..len]);
        let attended = Attended { queries, keys, values, width, n_heads: self.n_heads };
        let n_heads = team::share(self.n_heads, scratch.n_members, 1);
        let n_scores = attended.n_queries() * n_keys;
        let out = scratch.attended[..queries.len()]
            .par_chunks_mut(n_heads * attended.n_queries() * attended.head_width());
        out.zip(scratch.scores.par_chunks_mut(n_scores)).enumerate().for_each(|(member, (out, scores))| {
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

/// The part of the working memory that heads are computed in.
struct AttentionScratch<'a> {
    n_members: usize,
    keys: &'a [f32],
    values: &'a [f32],
    attended: &'a mut [f32],
    scores: &'a mut [f32],
}

/// Lends [`AttentionScratch`] out of a [`TransformerScratch`], other fields staying free.
macro_rules! attention_scratch {
    ($scratch:expr) => {
        &mut AttentionScratch {
            n_members: $scratch.n_members,
            keys: &$scratch.keys,
            values: &$scratch.values,
            attended: &mut $scratch.attended,
            scores: &mut $scratch.scores,
        }
    };
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
        let hidden = &mut hidden[..x.len() / self.up.n_in() * self.up.n_out()];
        self.up.run(x, hidden);
        relu(hidden);
        self.down.add_to(hidden, x);
    }
}

/// One encoder layer.
#[derive(Clone, Debug)]
pub(super) struct EncoderLayer {
    attention: Attention,
    norm1: LayerNorm,
    feed_forward: FeedForward,
    norm2: LayerNorm,
}

impl EncoderLayer {
    /// From checked weights; `layer` as in `transformer.encoder.layers.0`.
    #[must_use]
    pub(super) fn new(architecture: &Architecture, weights: &Weights, layer: &str) -> Self {
        Self {
            attention: Attention::new(architecture, weights, &format!("{layer}.self_attn")),
            norm1: layer_norm(weights, &format!("{layer}.norm1")),
            feed_forward: FeedForward::new(weights, layer),
            norm2: layer_norm(weights, &format!("{layer}.norm2")),
        }
    }

    /// Transforms the tokens `x [T, D]`, whose positions are `positions [T, D]`, in place.
    pub(super) fn run(&self, x: &mut [f32], positions: &[f32], scratch: &mut TransformerScratch) {
        let width = self.attention.out.n_in();
        let n_tokens = x.len() / width;
        project_all(&self.attention, x, positions, scratch);
        let queries = &scratch.queries[..x.len()];
        self.attention.attend(queries, n_tokens, attention_scratch!(scratch));
        let rows = team::rows(n_tokens, scratch.n_members);
        let (attended, inner) = (&scratch.attended[..], self.feed_forward.up.n_out());
        x.par_chunks_mut(rows * width).zip(scratch.hidden.par_chunks_mut(rows * inner)).enumerate().for_each(
            |(member, (x, hidden))| {
                self.attention.add_to(attended, n_tokens, member * rows, x);
                self.norm1.run(x);
                self.feed_forward.add_to(x, hidden);
                self.norm2.run(x);
            },
        );
    }
}

/// Queries and keys of `x [T, D]` with its positions, values of `x` alone.
fn project_all(attention: &Attention, x: &[f32], positions: &[f32], scratch: &mut TransformerScratch) {
    let len = team::rows(x.len() / attention.out.n_in(), scratch.n_members) * attention.out.n_in();
    let inputs = x.par_chunks(len).zip(positions.par_chunks(len));
    let outputs = scratch.placed.par_chunks_mut(len).zip(scratch.queries.par_chunks_mut(len));
    let outputs = outputs.zip(scratch.keys.par_chunks_mut(len)).zip(scratch.values.par_chunks_mut(len));
    inputs.zip(outputs).for_each(|((x, positions), (((placed, queries), keys), values))| {
        let placed = &mut placed[..x.len()];
        add(x, positions, placed);
        attention.query.run(placed, &mut queries[..x.len()]);
        attention.key.run(placed, &mut keys[..x.len()]);
        attention.value.run(x, &mut values[..x.len()]);
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
    norm2: LayerNorm,
    feed_forward: FeedForward,
    norm3: LayerNorm,
}

impl DecoderLayer {
    fn new(architecture: &Architecture, weights: &Weights, layer: &str) -> Self {
        let norm = |idx: usize| layer_norm(weights, &format!("{layer}.norm{idx}"));
        Self {
            own: Attention::new(architecture, weights, &format!("{layer}.self_attn")),
            norm1: norm(1),
            cross: Attention::new(architecture, weights, &format!("{layer}.multihead_attn")),
            norm2: norm(2),
            feed_forward: FeedForward::new(weights, layer),
            norm3: norm(3),
        }
    }

    /// Self-attention of the target `x [Q, D]`, in place, and then its queries to the memory.
    fn attend_to_target(&self, x: &mut [f32], query_positions: &[f32], scratch: &mut TransformerScratch) {
        let width = self.own.out.n_in();
        let n_queries = x.len() / width;
        project_all(&self.own, x, query_positions, scratch);
        let queries = &scratch.queries[..x.len()];
        self.own.attend(queries, n_queries, attention_scratch!(scratch));
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
        let queries = &scratch.queries[..x.len()];
        self.cross.attend(queries, n_tokens, attention_scratch!(scratch));
        let rows = team::rows(n_queries, scratch.n_members);
        let (attended, inner) = (&scratch.attended[..], self.feed_forward.up.n_out());
        x.par_chunks_mut(rows * width).zip(scratch.hidden.par_chunks_mut(rows * inner)).enumerate().for_each(
            |(member, (x, hidden))| {
                self.cross.add_to(attended, n_queries, member * rows, x);
                self.norm2.run(x);
                self.feed_forward.add_to(x, hidden);
                self.norm3.run(x);
            },
        );
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
    pub(super) fn new(architecture: &Architecture, weights: &Weights) -> Self {
        let layer =
            |idx| DecoderLayer::new(architecture, weights, &format!("transformer.decoder.layers.{idx}"));
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
            action_head: linear(weights, "action_head"),
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
