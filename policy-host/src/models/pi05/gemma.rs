//! Gemma (Gemma team: Gemma: open models based on Gemini research and technology, 2024), which reads the
//! tokens of images, instruction and state. Only the keys and values of its layers are used: the prefix of
//! the expert's attention.

use rayon::prelude::*;

use super::architecture::{GemmaSizes, LayerStack};
use super::layers::{AttentionInput, EPSILON, LayerSource, Sequence, add_rows, attend, in_row_blocks};
use crate::nn::gelu::geglu;
use crate::nn::norm::rms_rows;
use crate::nn::projection::Projection;
use crate::nn::rotary::Rotary;
use crate::weights::{StoredTensor, WeightsError};

/// The matrices of a Gemma layer, in the language model and in the expert.
#[derive(Debug)]
pub(crate) struct GemmaLayer {
    pub(crate) queries: Projection,
    pub(crate) keys: Projection,
    pub(crate) values: Projection,
    pub(crate) out: Projection,
    gate: Projection,
    up: Projection,
    down: Projection,
}

/// The language model.
#[derive(Debug)]
pub(crate) struct LanguageModel {
    sizes: GemmaSizes,
    /// Token embedding `[vocabulary, width]`.
    embedding: StoredTensor,
    layers: Vec<PrefixLayer>,
}

#[derive(Debug)]
struct PrefixLayer {
    matrices: GemmaLayer,
    /// Scale of the normalisation before attention, `[width]`.
    attention_scale: Vec<f32>,
    /// Scale of the normalisation before the MLP, `[width]`.
    mlp_scale: Vec<f32>,
}

/// Keys and values of a batch of sequences, one entry per layer, with room for further rows behind each
/// sequence.
#[derive(Debug)]
pub(crate) struct KeyValueCache {
    /// Keys and values `[Σ (length + room), head_width]` of each layer, without padding.
    layers: Vec<(Vec<f32>, Vec<f32>)>,
    /// Length of each sequence.
    lengths: Vec<usize>,
    room: usize,
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

impl GemmaLayer {
    pub(crate) fn load(
        source: LayerSource<'_>,
        part: LayerStack,
        layer: usize,
    ) -> Result<Self, WeightsError> {
        let matrix = |name: &str| source.matrix(&source.names.layer(part, layer, &format!("{name}.weight")));
        Ok(Self {
            queries: matrix("self_attn.q_proj")?,
            keys: matrix("self_attn.k_proj")?,
            values: matrix("self_attn.v_proj")?,
            out: matrix("self_attn.o_proj")?,
            gate: matrix("mlp.gate_proj")?,
            up: matrix("mlp.up_proj")?,
            down: matrix("mlp.down_proj")?,
        })
    }

    /// Computes the MLP of normalised rows `x [t, width]` in place, `down(gelu(gate(x)) · up(x))`.
    pub(crate) fn mlp(&self, x: &mut [f32]) {
        let hidden = self.gate.out_features();
        let n_rows = x.len() / self.gate.in_features();
        let (mut gate, mut up) = (vec![0.0; n_rows * hidden], vec![0.0; n_rows * hidden]);
        self.gate.forward(x, &mut gate);
        self.up.forward(x, &mut up);
        gate.par_chunks_exact_mut(hidden)
            .zip(up.par_chunks_exact(hidden))
            .for_each(|(gate, up)| geglu(gate, up));
        self.down.forward(&gate, x);
    }
}

impl LanguageModel {
    pub(crate) fn load(source: LayerSource<'_>, sizes: GemmaSizes) -> Result<Self, WeightsError> {
        let layer = |layer: usize| -> Result<PrefixLayer, WeightsError> {
            let scale = |name: &str| -> Result<Vec<f32>, WeightsError> {
                let stored = source.vector(&source.names.layer(LayerStack::Prefix, layer, name))?;
                Ok(stored.into_iter().map(|weight| 1.0 + weight).collect())
            };
            Ok(PrefixLayer {
                matrices: GemmaLayer::load(source, LayerStack::Prefix, layer)?,
                attention_scale: scale("input_layernorm.weight")?,
                mlp_scale: scale("post_attention_layernorm.weight")?,
            })
        };
        let layers = (0..sizes.depth).map(layer).collect::<Result<_, _>>()?;
        Ok(Self { sizes, embedding: source.tensor(&source.names.embedding())?, layers })
    }

    /// Writes the embedding of a token, multiplied by √width, to `row [width]`.
    pub(crate) fn embed(&self, token: u32, row: &mut [f32]) {
        embed(&self.embedding, token, row);
    }

    /// Computes the first layer's MLP with as many rows as an image has tokens, and returns the number of
    /// floating-point operations.
    pub(crate) fn compute_sample(&self) -> u64 {
        const N_ROWS: usize = 256;
        let GemmaSizes { width, hidden, .. } = self.sizes;
        self.layers[0].matrices.mlp(&mut vec![0.5; N_ROWS * width]);
        (2 * 3 * N_ROWS * width * hidden) as u64
    }

    /// Reads a batch of sequences, `x [Σ lengths, width]`, and returns the keys and values of every layer.
    /// All tokens of a sequence attend to each other.
    pub(crate) fn read(
        &self,
        mut x: Vec<f32>,
        lengths: &[usize],
        room: usize,
        rotary: &Rotary,
    ) -> KeyValueCache {
        let GemmaSizes { width, n_heads, head_width, .. } = self.sizes;
        let mut cache = KeyValueCache::new(self.layers.len(), lengths, room, head_width);
        let (positions, sequences) = (cache.positions(CacheRows::Prefix), cache.sequences(CacheRows::Prefix));
        for (idx, layer) in self.layers.iter().enumerate() {
            let matrices = &layer.matrices;
            let mut normed = normalised(&x, &layer.attention_scale);
            cache.store(idx, matrices, &normed, CacheRows::Prefix, rotary);
            // Nothing reads what the last layer would add to the tokens.
            if idx + 1 == self.layers.len() {
                break;
            }
            let mut queries = vec![0.0; positions.len() * n_heads * head_width];
            matrices.queries.forward(&normed, &mut queries);
            turn(&mut queries, n_heads * head_width, &positions, rotary);
            let mut heads = vec![0.0; queries.len()];
            attend(cache.input(idx, &queries, n_heads, head_width), &sequences, &mut heads);
            matrices.out.forward(&heads, &mut normed);
            add_rows(&mut x, &normed);
            in_row_blocks(&mut x, width, |x| {
                let mut normed = normalised(x, &layer.mlp_scale);
                matrices.mlp(&mut normed);
                add_rows(x, &normed);
            });
        }
        cache
    }
}

impl KeyValueCache {
    fn new(n_layers: usize, lengths: &[usize], room: usize, head_width: usize) -> Self {
        let n_rows = lengths.iter().map(|length| length + room).sum::<usize>();
        let layer = || (vec![0.0; n_rows * head_width], vec![0.0; n_rows * head_width]);
        Self {
            layers: std::iter::repeat_with(layer).take(n_layers).collect(),
            lengths: lengths.to_vec(),
            room,
        }
    }

    /// Returns the sequences whose queries are these rows. They attend to the whole prefix, and to the rows
    /// behind it if the queries are among them.
    pub(crate) fn sequences(&self, rows: CacheRows) -> Vec<Sequence> {
        let (mut first_query, mut first_key) = (0, 0);
        let of_sequence = |&length: &usize| {
            let (first, n_queries) = rows.of_sequence(length);
            let sequence = Sequence { first_query, n_queries, first_key, n_keys: first + n_queries };
            first_query += n_queries;
            first_key += length + self.room;
            sequence
        };
        self.lengths.iter().map(of_sequence).collect()
    }

    /// Computes keys and values of normalised rows and stores them.
    pub(crate) fn store(
        &mut self,
        layer: usize,
        matrices: &GemmaLayer,
        normed: &[f32],
        rows: CacheRows,
        rotary: &Rotary,
    ) {
        let head_width = matrices.keys.out_features();
        let n_rows = normed.len() / matrices.keys.in_features();
        let (mut keys, mut values) = (vec![0.0; n_rows * head_width], vec![0.0; n_rows * head_width]);
        matrices.keys.forward(normed, &mut keys);
        matrices.values.forward(normed, &mut values);
        turn(&mut keys, head_width, &self.positions(rows), rotary);
        let (all_keys, all_values) = &mut self.layers[layer];
        let (mut from, mut to) = (0, 0);
        for &length in &self.lengths {
            let (first, count) = rows.of_sequence(length);
            let source = from * head_width..(from + count) * head_width;
            let start = (to + first) * head_width;
            all_keys[start..][..source.len()].copy_from_slice(&keys[source.clone()]);
            all_values[start..][..source.len()].copy_from_slice(&values[source]);
            from += count;
            to += length + self.room;
        }
    }

    /// Returns the positions of these rows of all sequences.
    pub(crate) fn positions(&self, rows: CacheRows) -> Vec<usize> {
        let of_sequence = |&length: &usize| {
            let (first, count) = rows.of_sequence(length);
            first..first + count
        };
        self.lengths.iter().flat_map(of_sequence).collect()
    }

    /// Returns the attention of a layer for these queries.
    pub(crate) fn input<'a>(
        &'a self,
        layer: usize,
        queries: &'a [f32],
        n_heads: usize,
        head_width: usize,
    ) -> AttentionInput<'a> {
        let (keys, values) = &self.layers[layer];
        AttentionInput { queries, keys, values, n_heads, head_width, shares_keys: true }
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

/// Turns the heads of every row of `x [t, width]` by its position.
pub(crate) fn turn(x: &mut [f32], width: usize, positions: &[usize], rotary: &Rotary) {
    x.par_chunks_exact_mut(width).zip(positions).for_each(|(row, &position)| rotary.turn(row, position));
}
