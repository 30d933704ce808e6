//! Multi-head attention over projected queries, keys and values.

use super::matmul::{Into, multiply, view, view_mut};
use super::norm::sum;

/// `[T, D] f32` whose rows lie `stride` numbers apart: a block of columns of a wider matrix.
#[derive(Clone, Copy, Debug)]
pub struct Columns<'a> {
    /// Starts at the first number of the block.
    pub data: &'a [f32],
    /// Numbers from one row to the next.
    pub stride: usize,
}

/// `out [n_queries, D]`: for each head, a mean of the values weighted by the softmax of `query · key`.
///
/// The queries are already divided by the root of the head's width. `scores` holds at least `n_queries · n_keys`
/// numbers of working memory.
///
/// # Panics
/// If the lengths do not fit.
pub fn attend(
    (queries, n_queries): (Columns<'_>, usize),
    (keys, values, n_keys): (Columns<'_>, Columns<'_>, usize),
    n_heads: usize,
    out: &mut [f32],
    scores: &mut [f32],
) {
    let width = out.len() / n_queries;
    let head_width = width / n_heads;
    assert_eq!(out.len(), n_queries * n_heads * head_width, "heads of equal width");
    let scores = &mut scores[..n_queries * n_keys];
    for first in (0..width).step_by(head_width) {
        multiply(
            view_mut(scores, n_queries, n_keys, n_keys),
            Into::Replace,
            view(&queries.data[first..], n_queries, head_width, queries.stride),
            view(&keys.data[first..], n_keys, head_width, keys.stride).transpose(),
        );
        scores.chunks_exact_mut(n_keys).for_each(softmax);
        multiply(
            view_mut(&mut out[first..], n_queries, head_width, width),
            Into::Replace,
            view(scores, n_queries, n_keys, n_keys),
            view(&values.data[first..], n_keys, head_width, values.stride),
        );
    }
}

/// `exp(x) / Σ exp(x)` in place.
pub fn softmax(row: &mut [f32]) {
    let highest = row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    row.iter_mut().for_each(|x| *x = exp_of_negative(*x - highest));
    let inverse = 1.0 / sum(row, |x| x);
    row.iter_mut().for_each(|x| *x *= inverse);
}

/// `exp(x)` for `x ≤ 0`, within two units in the last place, in plain arithmetic that the compiler can vectorise and
/// that is the same on every machine (the C library's is neither).
///
/// `x = n·ln 2 + r` with `|r| ≤ ln 2 / 2`, then the Taylor series of `exp(r)` to the seventh power, times `2ⁿ`.
fn exp_of_negative(x: f32) -> f32 {
    /// 1.5 · 2²³: adding it leaves the nearest integer in the low bits of the mantissa.
    const ROUND: f32 = 12_582_912.0;
    /// ln 2 split in two, so that `n · LN_2_HIGH` is exact.
    const LN_2_HIGH: f32 = 0.693_359_4;
    const LN_2_LOW: f32 = -2.121_944_4e-4;
    let x = x.max(-87.0);
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
            let exact = f64::from(x).exp();
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
