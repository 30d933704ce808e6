//! Layer normalisation.

use super::isa::multiversion;

/// Number of partial sums of a reduction. It fixes the order of additions and lets the compiler vectorise
/// them.
pub(super) const LANES: usize = 16;

/// Layer normalisation over the last axis.
#[derive(Clone, Debug)]
pub struct LayerNorm {
    /// Scale of each entry, `[d]`.
    weight: Vec<f32>,
    /// Offset of each entry, `[d]`.
    bias: Vec<f32>,
}

impl LayerNorm {
    /// Term added to the variance (PyTorch's default `eps`).
    pub const EPSILON: f32 = 1e-5;

    /// Creates the layer from `weight [d]` and `bias [d]`.
    #[must_use]
    pub fn new(weight: &[f32], bias: &[f32]) -> Self {
        assert_eq!(weight.len(), bias.len(), "weight and bias");
        Self { weight: weight.to_vec(), bias: bias.to_vec() }
    }

    /// Normalises every row of `x [t, d]` in place.
    pub fn forward(&self, x: &mut [f32]) {
        normalise_rows(x, &self.weight, &self.bias);
    }
}

multiversion! {
    fn normalise_rows(x: &mut [f32], weight: &[f32], bias: &[f32]) {
        let width = weight.len() as f32;
        for row in x.chunks_exact_mut(weight.len()) {
            let mean = sum(row, |x| x) / width;
            let variance = sum(row, |x| (x - mean) * (x - mean)) / width;
            let inverse = 1.0 / (variance + LayerNorm::EPSILON).sqrt();
            for ((x, weight), bias) in row.iter_mut().zip(weight).zip(bias) {
                *x = (*x - mean) * inverse * weight + bias;
            }
        }
    }
}

/// Returns `Σ f(x)`, summed in a fixed order.
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
