//! Layers of a π0.5 network, built from the tensors of a checkpoint.

use rayon::prelude::*;

use super::checkpoint::names::Pi05Names;
use crate::nn::Precision;
use crate::nn::attention::AttentionHead;
use crate::nn::norm::LayerNorm;
use crate::nn::projection::Projection;
use crate::weights::{StoredTensor, TensorFolder, WeightsError};

/// Term added to variances and mean squares, in SigLIP and in Gemma.
pub(crate) const EPSILON: f32 = 1e-6;

/// The tensors of a checkpoint and the precision of the layers to build from them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LayerSource<'a> {
    pub(crate) tensors: &'a TensorFolder,
    pub(crate) names: &'a Pi05Names,
    pub(crate) precision: Precision,
}

impl LayerSource<'_> {
    pub(crate) fn tensor(&self, name: &str) -> Result<StoredTensor, WeightsError> {
        self.tensors.tensor(name)
    }

    pub(crate) fn vector(&self, name: &str) -> Result<Vec<f32>, WeightsError> {
        Ok(self.tensor(name)?.values())
    }

    /// Builds a layer without bias.
    pub(crate) fn matrix(&self, name: &str) -> Result<Projection, WeightsError> {
        Ok(Projection::new(self.tensor(name)?, None, self.precision))
    }

    /// Builds a layer from the tensors that `name` returns for `weight` and `bias`.
    pub(crate) fn linear(&self, name: impl Fn(&str) -> String) -> Result<Projection, WeightsError> {
        self.linear_with(name, self.precision)
    }

    /// Like [`linear`](Self::linear), with the weights as stored.
    pub(crate) fn exact_linear(&self, name: impl Fn(&str) -> String) -> Result<Projection, WeightsError> {
        self.linear_with(name, Precision::F32)
    }

    pub(crate) fn layer_norm(&self, name: impl Fn(&str) -> String) -> Result<LayerNorm, WeightsError> {
        let (weight, bias) = (self.vector(&name("weight"))?, self.vector(&name("bias"))?);
        Ok(LayerNorm::with_epsilon(&weight, &bias, EPSILON))
    }

    fn linear_with(
        &self,
        name: impl Fn(&str) -> String,
        precision: Precision,
    ) -> Result<Projection, WeightsError> {
        let (weight, bias) = (self.tensor(&name("weight"))?, self.vector(&name("bias"))?);
        Ok(Projection::new(weight, Some(bias), precision))
    }
}

/// The rows of one sequence in a batch whose sequences follow each other without padding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sequence {
    /// First row of its queries.
    pub(crate) first_query: usize,
    pub(crate) n_queries: usize,
    /// First row of its keys and values.
    pub(crate) first_key: usize,
    pub(crate) n_keys: usize,
}

/// Queries, keys and values of all sequences.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AttentionInput<'a> {
    /// Queries `[t, n_heads · head_width]`.
    pub(crate) queries: &'a [f32],
    /// Keys `[t, head_width]` that all heads share, or `[t, n_heads · head_width]`.
    pub(crate) keys: &'a [f32],
    /// Values, in the shape of the keys.
    pub(crate) values: &'a [f32],
    pub(crate) n_heads: usize,
    pub(crate) head_width: usize,
    /// `true` if all heads share keys and values.
    pub(crate) shares_keys: bool,
}

/// Computes the attention of every sequence over its own keys, `out [t, n_heads · head_width]`, without a
/// mask. The threads of the current rayon pool share sequences and heads.
pub(crate) fn attend(input: AttentionInput<'_>, sequences: &[Sequence], out: &mut [f32]) {
    let AttentionInput { queries, keys, values, n_heads, head_width, shares_keys } = input;
    let width = n_heads * head_width;
    let key_stride = if shares_keys { head_width } else { width };
    let scale = 1.0 / (head_width as f32).sqrt();
    // Each head first writes its own memory `[n_queries, head_width]`.
    let mut by_head = vec![0.0; out.len()];
    let mut jobs = Vec::with_capacity(sequences.len() * n_heads);
    let mut rest = &mut by_head[..];
    for sequence in sequences {
        for head in 0..n_heads {
            let (own, others) = rest.split_at_mut(sequence.n_queries * head_width);
            jobs.push((sequence, head, own));
            rest = others;
        }
    }
    jobs.into_par_iter().for_each_init(Vec::new, |scores, (sequence, head, out)| {
        scores.resize(scores.len().max(AttentionHead::scores_len(sequence.n_keys)), 0.0);
        let first_key = sequence.first_key * key_stride + if shares_keys { 0 } else { head * head_width };
        let head = AttentionHead {
            queries: &queries[sequence.first_query * width + head * head_width..],
            query_stride: width,
            keys: &keys[first_key..],
            values: &values[first_key..],
            key_stride,
            n_keys: sequence.n_keys,
            width: head_width,
        };
        head.attend(scale, out, scores);
    });
    let mut rest = &mut out[..];
    let mut first = 0;
    for sequence in sequences {
        let len = sequence.n_queries * width;
        let (own, others) = rest.split_at_mut(len);
        let heads = &by_head[first..first + len];
        own.par_chunks_exact_mut(width).enumerate().for_each(|(query, row)| {
            for (head, out) in row.chunks_exact_mut(head_width).enumerate() {
                let start = (head * sequence.n_queries + query) * head_width;
                out.copy_from_slice(&heads[start..start + head_width]);
            }
        });
        first += len;
        rest = others;
    }
}

/// Rows that pass through an MLP together. It bounds the memory of the hidden layer, the widest of a network.
const BLOCK_ROWS: usize = 512;
/// Values that one thread adds at a time.
const ADD_LEN: usize = 16 << 10;

/// Computes `x += y`.
pub(crate) fn add_rows(x: &mut [f32], y: &[f32]) {
    x.par_chunks_mut(ADD_LEN).zip(y.par_chunks(ADD_LEN)).for_each(|(x, y)| {
        x.iter_mut().zip(y).for_each(|(x, y)| *x += y);
    });
}

/// Calls `compute` with blocks of up to [`BLOCK_ROWS`] rows of `x [t, width]`.
pub(crate) fn in_row_blocks(x: &mut [f32], width: usize, compute: impl FnMut(&mut [f32])) {
    x.chunks_mut(BLOCK_ROWS * width).for_each(compute);
}
