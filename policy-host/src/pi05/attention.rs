//! Attention of all heads of a batch of sequences.

use rayon::prelude::*;

use crate::nn::attention::AttentionHead;

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
