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
    q_proj: Linear,
    k_proj: Linear,
    v_proj: Linear,
    out_proj: Linear,
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
            q_proj: projection(0, scale),
            k_proj: projection(1, 1.0),
            v_proj: projection(2, 1.0),
            out_proj: linear(state_dict, precision, &format!("{name}.out_proj")),
            n_heads: architecture.n_heads,
        }
    }

    /// Computes attention from the projections in `scratch` into `scratch.attended`.
    fn attend(&self, n_queries: usize, n_keys: usize, scratch: &mut TransformerScratch) {
        let TransformerScratch { n_members, queries, keys, values, attended: out, scores, .. } = scratch;
        let width = self.out_proj.in_features();
        let (queries, len) = (&queries[..n_queries * width], n_keys * width);
        let qkv = Qkv { queries, keys: &keys[..len], values: &values[..len], width, n_heads: self.n_heads };
        let n_heads = team::share(self.n_heads, *n_members, 1);
        let out = out[..queries.len()].par_chunks_mut(n_heads * n_queries * qkv.head_width());
        out.zip(scores.par_chunks_mut(n_queries * n_keys)).enumerate().for_each(|(member, (out, scores))| {
            qkv.attention(member * n_heads, out, scores);
        });
    }

    /// Computes `x += out_proj(attended)` for the rows of `x`, which start at `first_row`. `attended` is
    /// `[n_heads, n_rows, d / n_heads]`.
    fn forward_add_out_proj(&self, attended: &[f32], n_rows: usize, first_row: usize, x: &mut [f32]) {
        let width = self.out_proj.in_features();
        let (head_width, n_x_rows) = (width / self.n_heads, x.len() / width);
        let block =
            |head: usize| &attended[(head * n_rows + first_row) * head_width..][..n_x_rows * head_width];
        self.out_proj.forward_add_blocks(self.n_heads, block, x);
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

/// Applies the second part of an encoder or decoder layer, after the attention heads: adds the output
/// projection of the first rows of `scratch.attended`, which has `n_attended` rows, to `x`, and applies the
/// feed-forward network in place, each followed by one of the two normalisations.
fn forward_output_and_feed_forward(
    attention: &MultiheadAttention,
    feed_forward: &FeedForward,
    [attention_norm, feed_forward_norm]: [&LayerNorm; 2],
    n_attended: usize,
    x: &mut [f32],
    scratch: &mut TransformerScratch,
) {
    let TransformerScratch { n_members, attended, hidden, .. } = scratch;
    let (width, inner) = (attention.out_proj.in_features(), feed_forward.linear1.out_features());
    let rows = team::rows_per_member(x.len() / width, *n_members);
    let bands = x.par_chunks_mut(rows * width).zip(hidden.par_chunks_mut(rows * inner));
    bands.enumerate().for_each(|(member, (x, hidden))| {
        attention.forward_add_out_proj(attended, n_attended, member * rows, x);
        attention_norm.forward(x);
        feed_forward.forward_add(x, hidden);
        feed_forward_norm.forward(x);
    });
}

/// A post-norm encoder layer.
#[derive(Clone, Debug)]
pub(crate) struct EncoderLayer {
    self_attn: MultiheadAttention,
    norm1: LayerNorm,
    feed_forward: FeedForward,
    norm2: LayerNorm,
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
        let name = format!("{layer}.self_attn");
        Self {
            self_attn: MultiheadAttention::new(architecture, state_dict, precision, &name),
            norm1: layer_norm(state_dict, &format!("{layer}.norm1")),
            feed_forward: FeedForward::new(state_dict, precision, layer),
            norm2: layer_norm(state_dict, &format!("{layer}.norm2")),
        }
    }

    /// Applies the layer in place to the tokens `x [t, d]` with position embeddings `positions [t, d]`.
    pub(crate) fn forward(&self, x: &mut [f32], positions: &[f32], scratch: &mut TransformerScratch) {
        let width = self.self_attn.out_proj.in_features();
        let n_tokens = x.len() / width;
        project_qkv(&self.self_attn, x, positions, scratch);
        self.self_attn.attend(n_tokens, n_tokens, scratch);
        let norms = [&self.norm1, &self.norm2];
        forward_output_and_feed_forward(&self.self_attn, &self.feed_forward, norms, n_tokens, x, scratch);
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
    let len = team::rows_per_member(x.len() / attention.out_proj.in_features(), scratch.n_members)
        * attention.out_proj.in_features();
    let positioned = scratch.positioned[..x.len()].par_chunks(len);
    positioned.zip(scratch.queries[..x.len()].par_chunks_mut(len)).for_each(|(positioned, queries)| {
        attention.q_proj.forward(positioned, queries);
    });
}

/// Projects `memory + positions` to keys and `memory [t, d]` to values.
fn project_kv(
    attention: &MultiheadAttention,
    memory: &[f32],
    positions: &[f32],
    scratch: &mut TransformerScratch,
) {
    let len = team::rows_per_member(memory.len() / attention.out_proj.in_features(), scratch.n_members)
        * attention.out_proj.in_features();
    let inputs = memory.par_chunks(len).zip(positions.par_chunks(len));
    let outputs = scratch.positioned.par_chunks_mut(len).zip(scratch.keys.par_chunks_mut(len));
    let outputs = outputs.zip(scratch.values.par_chunks_mut(len));
    inputs.zip(outputs).for_each(|((memory, positions), ((positioned, keys), values))| {
        let positioned = &mut positioned[..memory.len()];
        add(memory, positions, positioned);
        attention.k_proj.forward(positioned, &mut keys[..memory.len()]);
        attention.v_proj.forward(memory, &mut values[..memory.len()]);
    });
}

/// A post-norm decoder layer.
#[derive(Clone, Debug)]
struct DecoderLayer {
    self_attn: MultiheadAttention,
    norm1: LayerNorm,
    multihead_attn: MultiheadAttention,
    norm2: LayerNorm,
    feed_forward: FeedForward,
    norm3: LayerNorm,
}

impl DecoderLayer {
    fn new(architecture: &Architecture, state_dict: &StateDict, precision: Precision, layer: &str) -> Self {
        let attention = |name: &str| {
            MultiheadAttention::new(architecture, state_dict, precision, &format!("{layer}.{name}"))
        };
        let norm = |idx: usize| layer_norm(state_dict, &format!("{layer}.norm{idx}"));
        Self {
            self_attn: attention("self_attn"),
            norm1: norm(1),
            multihead_attn: attention("multihead_attn"),
            norm2: norm(2),
            feed_forward: FeedForward::new(state_dict, precision, layer),
            norm3: norm(3),
        }
    }

    /// Applies self-attention to the target `x [q, d]` in place, then projects the queries of the
    /// cross-attention.
    fn attend_to_target(&self, x: &mut [f32], query_positions: &[f32], scratch: &mut TransformerScratch) {
        let width = self.self_attn.out_proj.in_features();
        let n_queries = x.len() / width;
        project_qkv(&self.self_attn, x, query_positions, scratch);
        self.self_attn.attend(n_queries, n_queries, scratch);
        self.self_attn.forward_add_out_proj(&scratch.attended, n_queries, 0, x);
        self.norm1.forward(x);
        let positioned = &mut scratch.positioned[..x.len()];
        add(x, query_positions, positioned);
        self.multihead_attn.q_proj.forward(positioned, &mut scratch.queries[..x.len()]);
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
        let width = self.multihead_attn.out_proj.in_features();
        let (n_queries, n_tokens) = (x.len() / width, memory.len() / width);
        project_kv(&self.multihead_attn, memory, positions, scratch);
        self.multihead_attn.attend(n_queries, n_tokens, scratch);
        let (norms, x) = ([&self.norm2, &self.norm3], &mut x[..n_rows * width]);
        forward_output_and_feed_forward(
            &self.multihead_attn,
            &self.feed_forward,
            norms,
            n_queries,
            x,
            scratch,
        );
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
    query_embed: Vec<f32>,
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
        let query_embed = state_dict.get("query_embed.weight").to_vec();
        let mut target = vec![0.0; query_embed.len()];
        let mut scratch = TransformerScratch::new(architecture, 1);
        layers[0].attend_to_target(&mut target, &query_embed, &mut scratch);
        Self {
            layers,
            queries: scratch.queries[..query_embed.len()].to_vec(),
            query_embed,
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
                layer.attend_to_target(&mut x, &self.query_embed, scratch);
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
