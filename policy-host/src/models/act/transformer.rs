//! ACT's transformer: post-norm encoder layers over the memory tokens, post-norm decoder layers over the
//! queries.
//!
//! Letters in shapes: `t` tokens, `d` model width, `f` hidden width, `q` queries. All work is divided among a
//! team of threads, by rows or by heads.

use rayon::prelude::*;

use super::architecture::Architecture;
use super::team;
use crate::nn::Precision;
use crate::nn::attention::Qkv;
use crate::nn::linear::{Linear, relu};
use crate::nn::norm::LayerNorm;
use crate::weights::StateDict;

/// Working memory of a transformer and its team.
#[derive(Clone, Debug)]
pub(crate) struct TransformerScratch {
    n_members: usize,
    /// Tokens plus position embeddings `[max(t, q), d]`.
    positioned: Vec<f32>,
    /// Projected queries `[max(t, q), d]`.
    queries: Vec<f32>,
    /// Projected keys `[max(t, q), d]`.
    keys: Vec<f32>,
    /// Projected values `[max(t, q), d]`.
    values: Vec<f32>,
    /// Attention output by head `[n_heads, max(t, q), d / n_heads]`.
    attended: Vec<f32>,
    /// Attention scores `[n_members, max(t, q)²]`.
    scores: Vec<f32>,
    /// Hidden activations of the feed-forward layers `[max(t, q), f]`.
    hidden: Vec<f32>,
    /// Decoder state `[q, d]`.
    decoded: Vec<f32>,
}

impl TransformerScratch {
    /// Allocates working memory for one sample and a team of `n_members` threads.
    #[must_use]
    pub(crate) fn new(architecture: &Architecture, n_members: usize) -> Self {
        let (width, horizon) = (architecture.hidden_dim, architecture.horizon);
        let rows = architecture.max_tokens().max(horizon);
        let tokens = vec![0.0; rows * width];
        Self {
            n_members,
            positioned: tokens.clone(),
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

/// The projections of a self- or cross-attention. The query projection includes the scale `1 / √head_width`.
#[derive(Clone, Debug)]
struct MultiheadAttention {
    query: Linear,
    key: Linear,
    value: Linear,
    out: Linear,
    n_heads: usize,
}

impl MultiheadAttention {
    /// Builds the projections from PyTorch's `MultiheadAttention` tensors, which stack query, key and value.
    fn new(architecture: &Architecture, state_dict: &StateDict, precision: Precision, name: &str) -> Self {
        let width = architecture.hidden_dim;
        let projection = |block: usize, factor: f32| {
            let scaled = |tensor: &str, len: usize| -> Vec<f32> {
                let values = state_dict.get(&format!("{name}.in_proj_{tensor}"));
                values[block * len..(block + 1) * len].iter().map(|x| x * factor).collect()
            };
            Linear::with_precision(&scaled("weight", width * width), &scaled("bias", width), precision)
        };
        let scale = 1.0 / ((width / architecture.n_heads) as f32).sqrt();
        Self {
            query: projection(0, scale),
            key: projection(1, 1.0),
            value: projection(2, 1.0),
            out: linear(state_dict, precision, &format!("{name}.out_proj")),
            n_heads: architecture.n_heads,
        }
    }

    /// Computes attention from the projections in `scratch` into `scratch.attended`.
    fn attend(&self, n_queries: usize, n_keys: usize, scratch: &mut TransformerScratch) {
        let TransformerScratch { n_members, queries, keys, values, attended: out, scores, .. } = scratch;
        let width = self.out.in_features();
        let (queries, len) = (&queries[..n_queries * width], n_keys * width);
        let qkv = Qkv { queries, keys: &keys[..len], values: &values[..len], width, n_heads: self.n_heads };
        let n_heads = team::share(self.n_heads, *n_members, 1);
        let out = out[..queries.len()].par_chunks_mut(n_heads * n_queries * qkv.head_width());
        out.zip(scores.par_chunks_mut(n_queries * n_keys)).enumerate().for_each(|(member, (out, scores))| {
            qkv.attention(member * n_heads, out, scores);
        });
    }

    /// Computes `x += out(attended)` for the rows of `x`, which start at `first_row`. `attended` is
    /// `[n_heads, n_rows, d / n_heads]`.
    fn forward_add_out(&self, attended: &[f32], n_rows: usize, first_row: usize, x: &mut [f32]) {
        let width = self.out.in_features();
        let (head_width, n_x_rows) = (width / self.n_heads, x.len() / width);
        let block =
            |head: usize| &attended[(head * n_rows + first_row) * head_width..][..n_x_rows * head_width];
        self.out.forward_add_blocks(self.n_heads, block, x);
    }
}

/// Feed-forward network: two linear layers with a ReLU in between.
#[derive(Clone, Debug)]
struct FeedForward {
    linear1: Linear,
    linear2: Linear,
}

impl FeedForward {
    fn new(state_dict: &StateDict, precision: Precision, layer: &str) -> Self {
        Self {
            linear1: linear(state_dict, precision, &format!("{layer}.linear1")),
            linear2: linear(state_dict, precision, &format!("{layer}.linear2")),
        }
    }

    /// Computes `x += linear2(relu(linear1(x)))`.
    fn forward_add(&self, x: &mut [f32], hidden: &mut [f32]) {
        let hidden = &mut hidden[..x.len() / self.linear1.in_features() * self.linear1.out_features()];
        self.linear1.forward(x, hidden);
        relu(hidden);
        self.linear2.forward_add(hidden, x);
    }
}

/// Second part of an encoder or decoder layer, after the attention heads: output projection and feed-forward
/// network, each followed by a layer normalisation.
#[derive(Clone, Debug)]
struct LayerTail {
    attention_norm: LayerNorm,
    feed_forward: FeedForward,
    feed_forward_norm: LayerNorm,
}

impl LayerTail {
    /// Builds the part from a checked state dict. `norms` are the indices of the two normalisations.
    fn new(state_dict: &StateDict, precision: Precision, layer: &str, norms: [usize; 2]) -> Self {
        let [attention_norm, feed_forward_norm] =
            norms.map(|idx| layer_norm(state_dict, &format!("{layer}.norm{idx}")));
        let feed_forward = FeedForward::new(state_dict, precision, layer);
        Self { attention_norm, feed_forward, feed_forward_norm }
    }

    /// Applies the output projection to the first rows of `scratch.attended`, which has `n_attended` rows,
    /// adds it to `x`, and applies the feed-forward network in place.
    fn forward(
        &self,
        attention: &MultiheadAttention,
        n_attended: usize,
        x: &mut [f32],
        scratch: &mut TransformerScratch,
    ) {
        let TransformerScratch { n_members, attended, hidden, .. } = scratch;
        let (width, inner) = (attention.out.in_features(), self.feed_forward.linear1.out_features());
        let rows = team::rows_per_member(x.len() / width, *n_members);
        let bands = x.par_chunks_mut(rows * width).zip(hidden.par_chunks_mut(rows * inner));
        bands.enumerate().for_each(|(member, (x, hidden))| {
            attention.forward_add_out(attended, n_attended, member * rows, x);
            self.attention_norm.forward(x);
            self.feed_forward.forward_add(x, hidden);
            self.feed_forward_norm.forward(x);
        });
    }
}

/// A post-norm encoder layer.
#[derive(Clone, Debug)]
pub(crate) struct EncoderLayer {
    attention: MultiheadAttention,
    tail: LayerTail,
}

impl EncoderLayer {
    /// Builds the layer from a checked state dict. `layer` is its name, for example
    /// `transformer.encoder.layers.0`.
    #[must_use]
    pub(crate) fn new(
        architecture: &Architecture,
        state_dict: &StateDict,
        precision: Precision,
        layer: &str,
    ) -> Self {
        Self {
            attention: MultiheadAttention::new(
                architecture,
                state_dict,
                precision,
                &format!("{layer}.self_attn"),
            ),
            tail: LayerTail::new(state_dict, precision, layer, [1, 2]),
        }
    }

    /// Applies the layer in place to the tokens `x [t, d]` with position embeddings `positions [t, d]`.
    pub(crate) fn forward(&self, x: &mut [f32], positions: &[f32], scratch: &mut TransformerScratch) {
        let width = self.attention.out.in_features();
        let n_tokens = x.len() / width;
        project_qkv(&self.attention, x, positions, scratch);
        self.attention.attend(n_tokens, n_tokens, scratch);
        self.tail.forward(&self.attention, n_tokens, x, scratch);
    }
}

/// Projects `x + positions` to queries and keys, and `x [t, d]` to values.
fn project_qkv(
    attention: &MultiheadAttention,
    x: &[f32],
    positions: &[f32],
    scratch: &mut TransformerScratch,
) {
    project_kv(attention, x, positions, scratch);
    let len = team::rows_per_member(x.len() / attention.out.in_features(), scratch.n_members)
        * attention.out.in_features();
    let positioned = scratch.positioned[..x.len()].par_chunks(len);
    positioned.zip(scratch.queries[..x.len()].par_chunks_mut(len)).for_each(|(positioned, queries)| {
        attention.query.forward(positioned, queries);
    });
}

/// Projects `memory + positions` to keys and `memory [t, d]` to values.
fn project_kv(
    attention: &MultiheadAttention,
    memory: &[f32],
    positions: &[f32],
    scratch: &mut TransformerScratch,
) {
    let len = team::rows_per_member(memory.len() / attention.out.in_features(), scratch.n_members)
        * attention.out.in_features();
    let inputs = memory.par_chunks(len).zip(positions.par_chunks(len));
    let outputs = scratch.positioned.par_chunks_mut(len).zip(scratch.keys.par_chunks_mut(len));
    let outputs = outputs.zip(scratch.values.par_chunks_mut(len));
    inputs.zip(outputs).for_each(|((memory, positions), ((positioned, keys), values))| {
        let positioned = &mut positioned[..memory.len()];
        add(memory, positions, positioned);
        attention.key.forward(positioned, &mut keys[..memory.len()]);
        attention.value.forward(memory, &mut values[..memory.len()]);
    });
}

/// A post-norm decoder layer.
#[derive(Clone, Debug)]
struct DecoderLayer {
    self_attn: MultiheadAttention,
    norm1: LayerNorm,
    cross_attn: MultiheadAttention,
    tail: LayerTail,
}

impl DecoderLayer {
    fn new(architecture: &Architecture, state_dict: &StateDict, precision: Precision, layer: &str) -> Self {
        Self {
            self_attn: MultiheadAttention::new(
                architecture,
                state_dict,
                precision,
                &format!("{layer}.self_attn"),
            ),
            norm1: layer_norm(state_dict, &format!("{layer}.norm1")),
            cross_attn: MultiheadAttention::new(
                architecture,
                state_dict,
                precision,
                &format!("{layer}.multihead_attn"),
            ),
            tail: LayerTail::new(state_dict, precision, layer, [2, 3]),
        }
    }

    /// Applies self-attention to the target `x [q, d]` in place, then projects the queries of the
    /// cross-attention.
    fn attend_to_target(&self, x: &mut [f32], query_positions: &[f32], scratch: &mut TransformerScratch) {
        let width = self.self_attn.out.in_features();
        let n_queries = x.len() / width;
        project_qkv(&self.self_attn, x, query_positions, scratch);
        self.self_attn.attend(n_queries, n_queries, scratch);
        self.self_attn.forward_add_out(&scratch.attended, n_queries, 0, x);
        self.norm1.forward(x);
        let positioned = &mut scratch.positioned[..x.len()];
        add(x, query_positions, positioned);
        self.cross_attn.query.forward(positioned, &mut scratch.queries[..x.len()]);
    }

    /// Applies cross-attention and the feed-forward network in place to the first `n_rows` rows of
    /// `x [q, d]`. The queries are in `scratch`.
    fn attend_to_memory(
        &self,
        (x, n_rows): (&mut [f32], usize),
        memory: &[f32],
        positions: &[f32],
        scratch: &mut TransformerScratch,
    ) {
        let width = self.cross_attn.out.in_features();
        let (n_queries, n_tokens) = (x.len() / width, memory.len() / width);
        project_kv(&self.cross_attn, memory, positions, scratch);
        self.cross_attn.attend(n_queries, n_tokens, scratch);
        self.tail.forward(&self.cross_attn, n_queries, &mut x[..n_rows * width], scratch);
    }
}

/// The decoder layers, the final normalisation and the action head.
///
/// The target starts at zero, so the first layer's output up to the cross-attention queries is the same for
/// every input. It is computed once, at construction.
#[derive(Clone, Debug)]
pub(crate) struct Decoder {
    layers: Vec<DecoderLayer>,
    /// Learned query position embeddings `[q, d]`.
    query_positions: Vec<f32>,
    /// Target `[q, d]` after the first layer's self-attention and normalisation.
    target: Vec<f32>,
    /// Queries `[q, d]` of the first cross-attention.
    queries: Vec<f32>,
    norm: LayerNorm,
    action_head: Linear,
}

impl Decoder {
    /// Builds the decoder from a checked state dict.
    #[must_use]
    pub(crate) fn new(architecture: &Architecture, state_dict: &StateDict, precision: Precision) -> Self {
        let layer = |idx| {
            DecoderLayer::new(
                architecture,
                state_dict,
                precision,
                &format!("transformer.decoder.layers.{idx}"),
            )
        };
        let layers: Vec<_> = (0..architecture.dec_layers).map(layer).collect();
        let query_positions = state_dict.get("query_embed.weight").to_vec();
        let mut target = vec![0.0; query_positions.len()];
        let mut scratch = TransformerScratch::new(architecture, 1);
        layers[0].attend_to_target(&mut target, &query_positions, &mut scratch);
        Self {
            layers,
            queries: scratch.queries[..query_positions.len()].to_vec(),
            query_positions,
            target,
            norm: layer_norm(state_dict, "transformer.decoder.norm"),
            action_head: linear(state_dict, Precision::F32, "action_head"),
        }
    }

    /// Computes the first rows of the action chunk, `actions [≤ q, action_dim]`, from the encoded tokens
    /// `memory [t, d]` and their position embeddings. The work after the last attention is done for these
    /// rows only; their bits do not depend on how many they are.
    pub(crate) fn forward(
        &self,
        memory: &[f32],
        positions: &[f32],
        scratch: &mut TransformerScratch,
        actions: &mut [f32],
    ) {
        let mut x = std::mem::take(&mut scratch.decoded);
        x.copy_from_slice(&self.target);
        scratch.queries[..x.len()].copy_from_slice(&self.queries);
        let width = self.action_head.in_features();
        let n_actions = actions.len() / self.action_head.out_features();
        for (idx, layer) in self.layers.iter().enumerate() {
            if idx > 0 {
                layer.attend_to_target(&mut x, &self.query_positions, scratch);
            }
            let is_last = idx + 1 == self.layers.len();
            let n_rows = if is_last { n_actions } else { x.len() / width };
            layer.attend_to_memory((&mut x, n_rows), memory, positions, scratch);
        }
        let decoded = &mut x[..n_actions * width];
        self.norm.forward(decoded);
        self.action_head.forward(decoded, actions);
        scratch.decoded = x;
    }
}

/// Builds the linear layer `name`.
pub(crate) fn linear(state_dict: &StateDict, precision: Precision, name: &str) -> Linear {
    let [weight, bias] = ["weight", "bias"].map(|part| state_dict.get(&format!("{name}.{part}")));
    Linear::with_precision(weight, bias, precision)
}

/// Builds the layer normalisation `name`.
pub(crate) fn layer_norm(state_dict: &StateDict, name: &str) -> LayerNorm {
    LayerNorm::new(state_dict.get(&format!("{name}.weight")), state_dict.get(&format!("{name}.bias")))
}

/// Computes `out = x + y`.
fn add(x: &[f32], y: &[f32], out: &mut [f32]) {
    assert_eq!((x.len(), y.len()), (out.len(), out.len()), "operands of equal length");
    out.iter_mut().zip(x).zip(y).for_each(|((out, x), y)| *out = x + y);
}
