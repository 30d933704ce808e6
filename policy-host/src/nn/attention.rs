//! Scaled dot-product attention with several heads, over projected queries, keys and values.

use super::gemm::matmul::{Accum, matmul, view, view_mut};
use super::isa::multiversion;
use super::norm::{LANES, sum};

/// Projected queries, keys and values, each `[t, d]` with the heads side by side. The queries are already
/// scaled by `1 / √head_width`.
#[derive(Clone, Copy, Debug)]
pub struct Qkv<'a> {
    /// Queries `[n_queries, d]`.
    pub queries: &'a [f32],
    /// Keys `[n_keys, d]`.
    pub keys: &'a [f32],
    /// Values `[n_keys, d]`.
    pub values: &'a [f32],
    /// Model width `d`.
    pub width: usize,
    /// Number of heads.
    pub n_heads: usize,
}

impl Qkv<'_> {
    /// Returns the number of queries.
    #[must_use]
    pub fn n_queries(&self) -> usize {
        self.queries.len() / self.width
    }

    /// Returns the number of keys, which is also the number of values.
    #[must_use]
    pub fn n_keys(&self) -> usize {
        self.keys.len() / self.width
    }

    /// Returns the width of a head.
    #[must_use]
    pub fn head_width(&self) -> usize {
        self.width / self.n_heads
    }

    /// Computes attention into `out [heads, n_queries, head_width]`, for as many heads as `out` holds,
    /// starting at `first_head`. `scores` is working memory of at least `n_queries · n_keys` values.
    ///
    /// # Panics
    /// If the lengths do not match.
    pub fn attention(&self, first_head: usize, out: &mut [f32], scores: &mut [f32]) {
        self.compute(first_head, out, scores, softmax_rows);
    }

    /// Like [`attention`](Self::attention) with a causal mask: query `i` attends only to keys up to `i`.
    ///
    /// # Panics
    /// If the lengths do not match.
    pub fn causal_attention(&self, first_head: usize, out: &mut [f32], scores: &mut [f32]) {
        assert_eq!(self.n_queries(), self.n_keys(), "one query per key");
        self.compute(first_head, out, scores, causal_softmax_rows);
    }

    fn compute(
        &self,
        first_head: usize,
        out: &mut [f32],
        scores: &mut [f32],
        softmax: fn(&mut [f32], usize),
    ) {
        let (n_queries, n_keys, width) = (self.n_queries(), self.n_keys(), self.head_width());
        assert_eq!(self.width, self.n_heads * width, "the heads must have equal width");
        assert_eq!(self.values.len(), self.keys.len(), "one value per key");
        let scores = &mut scores[..n_queries * n_keys];
        for (head, out) in out.chunks_exact_mut(n_queries * width).enumerate() {
            let first = (first_head + head) * width;
            matmul(
                view_mut(scores, n_queries, n_keys, n_keys),
                Accum::Replace,
                view(&self.queries[first..], n_queries, width, self.width),
                view(&self.keys[first..], n_keys, width, self.width).transpose(),
            );
            softmax(scores, n_keys);
            matmul(
                view_mut(out, n_queries, width, width),
                Accum::Replace,
                view(scores, n_queries, n_keys, n_keys),
                view(&self.values[first..], n_keys, width, self.width),
            );
        }
    }
}

/// One head of an attention whose keys and values may be shared by several heads: queries, keys and values
/// are rows of a common width, apart by a stride.
#[derive(Clone, Copy, Debug)]
pub struct AttentionHead<'a> {
    /// Queries `[n_queries, width]`.
    pub queries: &'a [f32],
    /// Distance between the first entries of two queries.
    pub query_stride: usize,
    /// Keys `[n_keys, width]`.
    pub keys: &'a [f32],
    /// Values `[n_keys, width]`.
    pub values: &'a [f32],
    /// Distance between the first entries of two keys, and of two values.
    pub key_stride: usize,
    /// Number of keys, which is also the number of values.
    pub n_keys: usize,
    /// Width of the head.
    pub width: usize,
}

impl AttentionHead<'_> {
    /// Queries whose scores are computed together, so that they stay in the cache.
    const BLOCK: usize = 128;

    /// Returns the length of the working memory for this number of keys.
    #[must_use]
    pub fn scores_len(n_keys: usize) -> usize {
        Self::BLOCK * n_keys
    }

    /// Computes `out [n_queries, width] = softmax(scale · queries · keysᵀ) · values`. `scores` is working
    /// memory of at least [`scores_len`](Self::scores_len).
    ///
    /// # Panics
    /// If the lengths do not match.
    pub fn attend(&self, scale: f32, out: &mut [f32], scores: &mut [f32]) {
        let &Self { queries, query_stride, keys, values, key_stride, n_keys, width } = self;
        for (block, out) in out.chunks_mut(Self::BLOCK * width).enumerate() {
            let n_queries = out.len() / width;
            let scores = &mut scores[..n_queries * n_keys];
            matmul(
                view_mut(scores, n_queries, n_keys, n_keys),
                Accum::Replace,
                view(&queries[block * Self::BLOCK * query_stride..], n_queries, width, query_stride),
                view(keys, n_keys, width, key_stride).transpose(),
            );
            scaled_softmax_rows(scores, n_keys, scale);
            matmul(
                view_mut(out, n_queries, width, width),
                Accum::Replace,
                view(scores, n_queries, n_keys, n_keys),
                view(values, n_keys, width, key_stride),
            );
        }
    }
}

multiversion! {
    /// Multiplies `x [t, n]` by `scale` and applies [`softmax`] to every row.
    fn scaled_softmax_rows(x: &mut [f32], n: usize, scale: f32) {
        for row in x.chunks_exact_mut(n) {
            row.iter_mut().for_each(|x| *x *= scale);
            softmax(row);
        }
    }

    /// Applies [`softmax`] to every row of `x [t, n]`.
    fn softmax_rows(x: &mut [f32], n: usize) {
        for row in x.chunks_exact_mut(n) {
            softmax(row);
        }
    }

    /// Applies [`softmax`] to the first `i + 1` entries of row `i` of `x [n, n]` and sets the others to zero.
    fn causal_softmax_rows(x: &mut [f32], n: usize) {
        for (idx, row) in x.chunks_exact_mut(n).enumerate() {
            let (visible, masked) = row.split_at_mut(idx + 1);
            softmax(visible);
            masked.fill(0.0);
        }
    }
}

/// Applies `exp(x) / Σ exp(x)` in place.
#[inline(always)]
pub fn softmax(row: &mut [f32]) {
    let max = max(row);
    for x in &mut *row {
        *x = exp_of_non_positive(*x - max);
    }
    let inverse = 1.0 / sum(row, |x| x);
    for x in row {
        *x *= inverse;
    }
}

/// Returns the maximum of a row without NaN.
#[inline(always)]
fn max(row: &[f32]) -> f32 {
    // One maximum per lane avoids a serial dependency chain. `if` instead of `f32::max`, which also handles
    // NaN.
    let mut lanes = [f32::NEG_INFINITY; LANES];
    let (chunks, rest) = row.as_chunks::<LANES>();
    for chunk in chunks {
        for (lane, &x) in lanes.iter_mut().zip(chunk) {
            *lane = if x > *lane { x } else { *lane };
        }
    }
    lanes.iter().chain(rest).copied().fold(f32::NEG_INFINITY, f32::max)
}

/// Returns `exp(x)` for `x ≤ 0`, within 2 ulp, in plain arithmetic that the compiler can vectorise and that
/// gives the same bits on every machine. The C library's `exp` does neither.
///
/// Decomposes `x = n·ln 2 + r` with `|r| ≤ ln 2 / 2` and evaluates the Taylor series of `exp(r)` to degree
/// seven, times `2ⁿ`.
#[inline(always)]
pub(crate) fn exp_of_non_positive(x: f32) -> f32 {
    /// 1.5 · 2²³. Adding it leaves the nearest integer in the low bits of the mantissa.
    const ROUND: f32 = 12_582_912.0;
    /// High part of ln 2, short enough that `n · LN_2_HIGH` is exact.
    const LN_2_HIGH: f32 = 0.693_359_4;
    const LN_2_LOW: f32 = -2.121_944_4e-4;
    let x = if x > -87.0 { x } else { -87.0 };
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = (x - n * LN_2_HIGH) - n * LN_2_LOW;
    let series = 1.0 / 5040.0;
    let series = series * r + 1.0 / 720.0;
    let series = series * r + 1.0 / 120.0;
    let series = series * r + 1.0 / 24.0;
    let series = series * r + 1.0 / 6.0;
    let series = series * r + 0.5;
    let series = (series * r + 1.0) * r + 1.0;
    let exponent = shifted.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127);
    series * f32::from_bits(exponent << 23)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_is_accurate_down_to_smallest_normal() {
        for step in 0..=87_000 {
            let x = -(step as f32) / 1000.0;
            let exact = libm::exp(f64::from(x));
            let error = (f64::from(exp_of_non_positive(x)) - exact).abs() / exact;
            assert!(error < 2.5e-7, "exp({x}): relative error {error}");
        }
    }

    #[test]
    fn softmax_of_distant_scores_sums_to_one() {
        let mut row: Vec<f32> = (0..147).map(|i| (i * i % 31) as f32 * 9.0 - 100.0).collect();
        softmax(&mut row);
        assert!((row.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        assert!(row.iter().all(|&x| (0.0..=1.0).contains(&x)));
    }
}
