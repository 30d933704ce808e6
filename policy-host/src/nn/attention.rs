//! Multi-head attention over projected queries, keys and values.

use super::matmul::{Into, multiply, view, view_mut};
use super::norm::{LANES, sum};
use super::wide::wide;

/// Queries, keys and values of an attention, each `[T, D]` with heads side by side. The queries are already divided by the
/// root of the head's width.
#[derive(Clone, Copy, Debug)]
pub struct Attended<'a> {
    /// `[n_queries, D]`.
    pub queries: &'a [f32],
    /// `[n_keys, D]`.
    pub keys: &'a [f32],
    /// `[n_keys, D]`.
    pub values: &'a [f32],
    /// `D`.
    pub width: usize,
    /// Heads in all.
    pub n_heads: usize,
}

impl Attended<'_> {
    /// Queries.
    #[must_use]
    pub fn n_queries(&self) -> usize {
        self.queries.len() / self.width
    }

    /// Keys, and values.
    #[must_use]
    pub fn n_keys(&self) -> usize {
        self.keys.len() / self.width
    }

    /// Width of a head.
    #[must_use]
    pub fn head_width(&self) -> usize {
        self.width / self.n_heads
    }

    /// `out [n_heads, n_queries, head width]` for as many heads from `first_head` on as fit into it: a mean of the values
    /// weighted by the softmax of `query · key`. `scores` holds at least `n_queries · n_keys` numbers of working memory.
    ///
    /// # Panics
    /// If the lengths do not fit.
    pub fn run(&self, first_head: usize, out: &mut [f32], scores: &mut [f32]) {
        self.weigh(first_head, out, scores, softmax_rows);
    }

    /// As [`run`](Self::run), where query `i` sees only the keys up to `i`.
    ///
    /// # Panics
    /// If the lengths do not fit.
    pub fn run_causal(&self, first_head: usize, out: &mut [f32], scores: &mut [f32]) {
        assert_eq!(self.n_queries(), self.n_keys(), "a query for each key");
        self.weigh(first_head, out, scores, causal_softmax_rows);
    }

    fn weigh(&self, first_head: usize, out: &mut [f32], scores: &mut [f32], weights: fn(&mut [f32], usize)) {
        let (n_queries, n_keys, width) = (self.n_queries(), self.n_keys(), self.head_width());
        assert_eq!(self.width, self.n_heads * width, "heads of equal width");
        assert_eq!(self.values.len(), self.keys.len(), "a value for each key");
        let scores = &mut scores[..n_queries * n_keys];
        for (head, out) in out.chunks_exact_mut(n_queries * width).enumerate() {
            let first = (first_head + head) * width;
            multiply(
                view_mut(scores, n_queries, n_keys, n_keys),
                Into::Replace,
                view(&self.queries[first..], n_queries, width, self.width),
                view(&self.keys[first..], n_keys, width, self.width).transpose(),
            );
            weights(scores, n_keys);
            multiply(
                view_mut(out, n_queries, width, width),
                Into::Replace,
                view(scores, n_queries, n_keys, n_keys),
                view(&self.values[first..], n_keys, width, self.width),
            );
        }
    }
}

wide! {
    /// [`softmax`] of every row of `x [T, n]`.
    fn softmax_rows(x: &mut [f32], n: usize) {
        for row in x.chunks_exact_mut(n) {
            softmax(row);
        }
    }

    /// [`softmax`] of the first `i + 1` numbers of row `i` of `x [n, n]`; the others become zero.
    fn causal_softmax_rows(x: &mut [f32], n: usize) {
        for (idx, row) in x.chunks_exact_mut(n).enumerate() {
            let (seen, unseen) = row.split_at_mut(idx + 1);
            softmax(seen);
            unseen.fill(0.0);
        }
    }
}

/// `exp(x) / Σ exp(x)` in place.
#[inline(always)]
pub fn softmax(row: &mut [f32]) {
    let highest = highest(row);
    for x in &mut *row {
        *x = exp_of_negative(*x - highest);
    }
    let inverse = 1.0 / sum(row, |x| x);
    for x in row {
        *x *= inverse;
    }
}

/// The largest number of a row without NaN.
#[inline(always)]
fn highest(row: &[f32]) -> f32 {
    // A maximum a lane, because one alone would be a chain. `if` and not `f32::max`, which also minds NaN.
    let mut lanes = [f32::NEG_INFINITY; LANES];
    let (chunks, rest) = row.as_chunks::<LANES>();
    for chunk in chunks {
        for (lane, &x) in lanes.iter_mut().zip(chunk) {
            *lane = if x > *lane { x } else { *lane };
        }
    }
    lanes.iter().chain(rest).copied().fold(f32::NEG_INFINITY, f32::max)
}

/// `exp(x)` for `x ≤ 0`, within two units in the last place, in plain arithmetic that the compiler can vectorise and
/// that is the same on every machine (the C library's is neither).
///
/// `x = n·ln 2 + r` with `|r| ≤ ln 2 / 2`, then the Taylor series of `exp(r)` to the seventh power, times `2ⁿ`.
#[inline(always)]
pub(super) fn exp_of_negative(x: f32) -> f32 {
    /// 1.5 · 2²³: adding it leaves the nearest integer in the low bits of the mantissa.
    const ROUND: f32 = 12_582_912.0;
    /// ln 2 split in two, so that `n · LN_2_HIGH` is exact.
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
    fn exp_is_accurate_down_to_the_smallest_normal_number() {
        for step in 0..=87_000 {
            let x = -(step as f32) / 1000.0;
            let exact = libm::exp(f64::from(x));
            let error = (f64::from(exp_of_negative(x)) - exact).abs() / exact;
            assert!(error < 2.5e-7, "exp({x}): relative error {error}");
        }
    }

    #[test]
    fn softmax_of_far_scores_sums_to_one() {
        let mut row: Vec<f32> = (0..147).map(|i| (i * i % 31) as f32 * 9.0 - 100.0).collect();
        softmax(&mut row);
        assert!((row.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        assert!(row.iter().all(|&x| (0.0..=1.0).contains(&x)));
    }
}
