//! Gemma (Gemma team: Gemma: open models based on Gemini research and technology, 2024), which processes the
//! tokens of images, instruction and state. Only the keys and values of its layers are used: the prefix of
//! the expert's attention.

use rayon::prelude::*;

use super::architecture::GemmaConfig;
use super::checkpoint::names::LayerStack;
use super::layers::{AttentionInput, EPSILON, LayerSource, Sequence, add_rows, attend, in_row_blocks};
use crate::nn::gelu::geglu;
use crate::nn::norm::rms_rows;
use crate::nn::projection::Projection;
use crate::nn::rotary::Rotary;
use crate::weights::{StoredTensor, WeightsError};

/// Attention of several query heads with one shared key and value head.
#[derive(Debug)]
pub(crate) struct GemmaAttention {
    q_proj: Projection,
    k_proj: Projection,
    v_proj: Projection,
    o_proj: Projection,
}

/// A gated MLP, `down(gelu(gate(x)) · up(x))`.
#[derive(Debug)]
pub(crate) struct GemmaMlp {
    gate_proj: Projection,
    up_proj: Projection,
    down_proj: Projection,
}

/// A transformer layer with normalisation before attention and before the MLP.
#[derive(Debug)]
struct GemmaDecoderLayer {
    /// Scale of the normalisation before attention, `[width]`.
    input_layernorm: Vec<f32>,
    self_attn: GemmaAttention,
    /// Scale of the normalisation before the MLP, `[width]`.
    post_attention_layernorm: Vec<f32>,
    mlp: GemmaMlp,
}

/// The language model.
#[derive(Debug)]
pub(crate) struct GemmaModel {
    config: GemmaConfig,
    /// Token embedding `[vocabulary, width]`.
    embed_tokens: StoredTensor,
    layers: Vec<GemmaDecoderLayer>,
}

/// Keys and values of a batch of sequences, one entry per layer, with room for further rows behind each
/// sequence.
#[derive(Debug)]
pub(crate) struct KeyValueCache {
    /// Keys and values `[Σ (length + max_suffix), head_width]` of each layer, without padding.
    layers: Vec<(Vec<f32>, Vec<f32>)>,
    /// Length of each sequence.
    lengths: Vec<usize>,
    max_suffix: usize,
    head_width: usize,
}

/// Rows of every sequence in a [`KeyValueCache`].
#[derive(Clone, Copy, Debug)]
pub(crate) enum CacheRows {
    /// The sequence itself.
    Prefix,
    /// This number of rows behind it.
    Suffix(usize),
}

impl CacheRows {
    /// Returns the first row and the number of rows for a sequence of this length.
    fn of_sequence(self, length: usize) -> (usize, usize) {
        match self {
            Self::Prefix => (0, length),
            Self::Suffix(count) => (length, count),
        }
    }
}

impl GemmaAttention {
    pub(crate) fn load(
        source: LayerSource<'_>,
        part: LayerStack,
        layer: usize,
    ) -> Result<Self, WeightsError> {
        let matrix =
            |name: &str| source.matrix(&source.names.layer(part, layer, &format!("self_attn.{name}.weight")));
        Ok(Self {
            q_proj: matrix("q_proj")?,
            k_proj: matrix("k_proj")?,
            v_proj: matrix("v_proj")?,
            o_proj: matrix("o_proj")?,
        })
    }

    /// Computes keys and values of normalised rows and stores them in the cache of a layer.
    fn store(
        &self,
        x: &[f32],
        (cache, layer): (&mut KeyValueCache, usize),
        rows: CacheRows,
        rotary: &Rotary,
    ) {
        let head_width = self.k_proj.out_features();
        let n_rows = x.len() / self.k_proj.in_features();
        let (mut keys, mut values) = (vec![0.0; n_rows * head_width], vec![0.0; n_rows * head_width]);
        self.k_proj.forward(x, &mut keys);
        self.v_proj.forward(x, &mut values);
        apply_rotary(&mut keys, head_width, &cache.positions(rows), rotary);
        cache.store(layer, &keys, &values, rows);
    }

    /// Stores the keys and values of normalised rows `x [t, width]`, and replaces the rows by their
    /// attention to all that the cache of the layer holds for their sequences.
    pub(crate) fn forward(
        &self,
        x: &mut [f32],
        (cache, layer): (&mut KeyValueCache, usize),
        rows: CacheRows,
        rotary: &Rotary,
    ) {
        self.store(x, (cache, layer), rows, rotary);
        let (width, head_width) = (self.q_proj.out_features(), self.k_proj.out_features());
        let mut queries = vec![0.0; x.len() / self.q_proj.in_features() * width];
        self.q_proj.forward(x, &mut queries);
        apply_rotary(&mut queries, width, &cache.positions(rows), rotary);
        let mut heads = vec![0.0; queries.len()];
        let (keys, values) = &cache.layers[layer];
        let n_heads = width / head_width;
        let input =
            AttentionInput { queries: &queries, keys, values, n_heads, head_width, shares_keys: true };
        attend(input, &cache.sequences(rows), &mut heads);
        self.o_proj.forward(&heads, x);
    }
}

impl GemmaMlp {
    pub(crate) fn load(
        source: LayerSource<'_>,
        part: LayerStack,
        layer: usize,
    ) -> Result<Self, WeightsError> {
        let matrix =
            |name: &str| source.matrix(&source.names.layer(part, layer, &format!("mlp.{name}.weight")));
        Ok(Self {
            gate_proj: matrix("gate_proj")?,
            up_proj: matrix("up_proj")?,
            down_proj: matrix("down_proj")?,
        })
    }

    /// Computes the MLP of normalised rows `x [t, width]` in place.
    pub(crate) fn forward(&self, x: &mut [f32]) {
        let hidden = self.gate_proj.out_features();
        let n_rows = x.len() / self.gate_proj.in_features();
        let (mut gate, mut up) = (vec![0.0; n_rows * hidden], vec![0.0; n_rows * hidden]);
        self.gate_proj.forward(x, &mut gate);
        self.up_proj.forward(x, &mut up);
        gate.par_chunks_exact_mut(hidden)
            .zip(up.par_chunks_exact(hidden))
            .for_each(|(gate, up)| geglu(gate, up));
        self.down_proj.forward(&gate, x);
    }
}

impl GemmaDecoderLayer {
    fn load(source: LayerSource<'_>, layer: usize) -> Result<Self, WeightsError> {
        let scale = |name: &str| -> Result<Vec<f32>, WeightsError> {
            let stored = source.vector(&source.names.layer(LayerStack::Prefix, layer, name))?;
            Ok(stored.into_iter().map(|weight| 1.0 + weight).collect())
        };
        Ok(Self {
            input_layernorm: scale("input_layernorm.weight")?,
            self_attn: GemmaAttention::load(source, LayerStack::Prefix, layer)?,
            post_attention_layernorm: scale("post_attention_layernorm.weight")?,
            mlp: GemmaMlp::load(source, LayerStack::Prefix, layer)?,
        })
    }
}

impl GemmaModel {
    pub(crate) fn load(source: LayerSource<'_>, config: GemmaConfig) -> Result<Self, WeightsError> {
        let layers = (0..config.num_hidden_layers).map(|layer| GemmaDecoderLayer::load(source, layer));
        let layers = layers.collect::<Result<_, _>>()?;
        Ok(Self { config, embed_tokens: source.tensor(&source.names.embedding())?, layers })
    }

    /// Writes the embedding of a token, multiplied by √width, to `row [width]`.
    pub(crate) fn embed(&self, token: u32, row: &mut [f32]) {
        embed(&self.embed_tokens, token, row);
    }

    /// Computes the first layer's MLP with as many rows as an image has tokens, and returns the number of
    /// floating-point operations.
    pub(crate) fn run_benchmark(&self) -> u64 {
        const N_ROWS: usize = 256;
        let GemmaConfig { hidden_size: width, intermediate_size: hidden, .. } = self.config;
        self.layers[0].mlp.forward(&mut vec![0.5; N_ROWS * width]);
        (2 * 3 * N_ROWS * width * hidden) as u64
    }

    /// Processes a batch of sequences, `x [Σ lengths, width]`, and returns the keys and values of every
    /// layer, with room for `max_suffix` rows behind each sequence. All tokens of a sequence attend to each
    /// other.
    pub(crate) fn prefill(
        &self,
        mut x: Vec<f32>,
        lengths: &[usize],
        max_suffix: usize,
        rotary: &Rotary,
    ) -> KeyValueCache {
        let GemmaConfig { hidden_size: width, head_dim: head_width, .. } = self.config;
        let mut cache = KeyValueCache::new(self.layers.len(), lengths, max_suffix, head_width);
        for (idx, layer) in self.layers.iter().enumerate() {
            let mut out = normalised(&x, &layer.input_layernorm);
            // Nothing reads what the last layer would add to the tokens.
            if idx + 1 == self.layers.len() {
                layer.self_attn.store(&out, (&mut cache, idx), CacheRows::Prefix, rotary);
                break;
            }
            layer.self_attn.forward(&mut out, (&mut cache, idx), CacheRows::Prefix, rotary);
            add_rows(&mut x, &out);
            in_row_blocks(&mut x, width, |x| {
                let mut out = normalised(x, &layer.post_attention_layernorm);
                layer.mlp.forward(&mut out);
                add_rows(x, &out);
            });
        }
        cache
    }
}

impl KeyValueCache {
    fn new(n_layers: usize, lengths: &[usize], max_suffix: usize, head_width: usize) -> Self {
        let n_rows = lengths.iter().map(|length| length + max_suffix).sum::<usize>();
        let layer = || (vec![0.0; n_rows * head_width], vec![0.0; n_rows * head_width]);
        Self {
            layers: std::iter::repeat_with(layer).take(n_layers).collect(),
            lengths: lengths.to_vec(),
            max_suffix,
            head_width,
        }
    }

    /// Returns the sequences whose queries are these rows. They attend to the whole prefix, and to the rows
    /// behind it if the queries are among them.
    fn sequences(&self, rows: CacheRows) -> Vec<Sequence> {
        let (mut first_query, mut first_key) = (0, 0);
        let of_sequence = |&length: &usize| {
            let (first, n_queries) = rows.of_sequence(length);
            let sequence = Sequence { first_query, n_queries, first_key, n_keys: first + n_queries };
            first_query += n_queries;
            first_key += length + self.max_suffix;
            sequence
        };
        self.lengths.iter().map(of_sequence).collect()
    }

    /// Stores keys and values `[rows, head_width]` of these rows of all sequences.
    fn store(&mut self, layer: usize, keys: &[f32], values: &[f32], rows: CacheRows) {
        let head_width = self.head_width;
        let (all_keys, all_values) = &mut self.layers[layer];
        let (mut from, mut to) = (0, 0);
        for &length in &self.lengths {
            let (first, count) = rows.of_sequence(length);
            let source = from * head_width..(from + count) * head_width;
            let start = (to + first) * head_width;
            all_keys[start..][..source.len()].copy_from_slice(&keys[source.clone()]);
            all_values[start..][..source.len()].copy_from_slice(&values[source]);
            from += count;
            to += length + self.max_suffix;
        }
    }

    /// Returns the positions of these rows of all sequences.
    fn positions(&self, rows: CacheRows) -> Vec<usize> {
        let of_sequence = |&length: &usize| {
            let (first, count) = rows.of_sequence(length);
            first..first + count
        };
        self.lengths.iter().flat_map(of_sequence).collect()
    }
}

/// Writes a row of a token embedding, multiplied by √width, to `row [width]`.
pub(crate) fn embed(embedding: &StoredTensor, token: u32, row: &mut [f32]) {
    embedding.read(token as usize * row.len(), row);
    let scale = (row.len() as f32).sqrt();
    row.iter_mut().for_each(|x| *x *= scale);
}

/// Returns `x / rms(x) · scale` for every row of `x`.
fn normalised(x: &[f32], scale: &[f32]) -> Vec<f32> {
    let zero = vec![0.0; scale.len()];
    let mut out = vec![0.0; x.len()];
    let rows = out.par_chunks_exact_mut(scale.len()).zip(x.par_chunks_exact(scale.len()));
    rows.for_each(|(out, row)| rms_rows(row, scale, &zero, EPSILON, out));
    out
}

/// Applies the rotary embedding to every row of `x [t, width]`.
fn apply_rotary(x: &mut [f32], width: usize, positions: &[usize], rotary: &Rotary) {
    x.par_chunks_exact_mut(width).zip(positions).for_each(|(row, &position)| rotary.apply(row, position));
}
