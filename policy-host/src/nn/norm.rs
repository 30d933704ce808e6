//! Layer normalisation.

use super::wide::wide;

/// Partial sums kept side by side, so that the order of additions is fixed and wide registers are used.
pub(super) const LANES: usize = 16;

/// Layer normalisation over the last axis.
#[derive(Clone, Debug)]
pub struct LayerNorm {
    scale: Vec<f32>,
    offset: Vec<f32>,
}

impl LayerNorm {
    /// Added to the variance (PyTorch's default).
    pub const EPSILON: f32 = 1e-5;

    /// From a checkpoint's `weight [D]` and `bias [D]`.
    #[must_use]
    pub fn new(weight: &[f32], bias: &[f32]) -> Self {
        assert_eq!(weight.len(), bias.len(), "scale and offset");
        Self { scale: weight.to_vec(), offset: bias.to_vec() }
    }

    /// Normalises every row of `x [T, D]` in place.
    pub fn run(&self, x: &mut [f32]) {
        normalise_rows(x, &self.scale, &self.offset);
    }
}

wide! {
    fn normalise_rows(x: &mut [f32], scale: &[f32], offset: &[f32]) {
        let width = scale.len() as f32;
        for row in x.chunks_exact_mut(scale.len()) {
            let mean = sum(row, |x| x) / width;
            let variance = sum(row, |x| (x - mean) * (x - mean)) / width;
            let inverse = 1.0 / (variance + LayerNorm::EPSILON).sqrt();
            for ((x, scale), offset) in row.iter_mut().zip(scale).zip(offset) {
                *x = (*x - mean) * inverse * scale + offset;
            }
        }
    }
}

/// `Σ f(x)` in a fixed order.
#[inline(always)]
pub(super) fn sum(row: &[f32], f: impl Fn(f32) -> f32) -> f32 {
    let mut lanes = [0.0; LANES];
    let (chunks, rest) = row.as_chunks::<LANES>();
    for chunk in chunks {
        for (lane, &x) in lanes.iter_mut().zip(chunk) {
            *lane += f(x);
        }
    }
    let mut rest_sum = 0.0;
    for &x in rest {
        rest_sum += f(x);
    }
    let mut width = LANES / 2;
    while width > 0 {
        for idx in 0..width {
            lanes[idx] += lanes[idx + width];
        }
        width /= 2;
    }
    lanes[0] + rest_sum
}
