//! Normalisation of rows: layer normalisation, and RMS normalisation with fixed or given scales.

use super::isa::multiversion;

/// Number of partial sums of a reduction. It fixes the order of additions and lets the compiler vectorise
/// them.
pub(crate) const LANES: usize = 16;

/// Layer normalisation over the last axis.
#[derive(Clone, Debug)]
pub struct LayerNorm {
    /// Scale of each entry, `[d]`.
    weight: Vec<f32>,
    /// Offset of each entry, `[d]`.
    bias: Vec<f32>,
    /// Term added to the variance.
    epsilon: f32,
}

impl LayerNorm {
    /// Term added to the variance (PyTorch's default `eps`).
    pub const EPSILON: f32 = 1e-5;

    /// Creates the layer from `weight [d]` and `bias [d]`.
    #[must_use]
    pub fn new(weight: &[f32], bias: &[f32]) -> Self {
        Self::with_epsilon(weight, bias, Self::EPSILON)
    }

    /// Like [`new`](Self::new), with another term added to the variance.
    #[must_use]
    pub fn with_epsilon(weight: &[f32], bias: &[f32], epsilon: f32) -> Self {
        assert_eq!(weight.len(), bias.len(), "weight and bias");
        Self { weight: weight.to_vec(), bias: bias.to_vec(), epsilon }
    }

    /// Normalises every row of `x [t, d]` in place.
    pub fn forward(&self, x: &mut [f32]) {
        normalise_rows(x, &self.weight, &self.bias, self.epsilon);
    }
}

multiversion! {
    fn normalise_rows(x: &mut [f32], weight: &[f32], bias: &[f32], epsilon: f32) {
        let width = weight.len() as f32;
        for row in x.chunks_exact_mut(weight.len()) {
            let mean = sum(row, |x| x) / width;
            let variance = sum(row, |x| (x - mean) * (x - mean)) / width;
            let inverse = 1.0 / (variance + epsilon).sqrt();
            for ((x, weight), bias) in row.iter_mut().zip(weight).zip(bias) {
                *x = (*x - mean) * inverse * weight + bias;
            }
        }
    }

    /// Computes `out [t, d] = x / rms(x) · scale + shift` for every row of `x [t, d]`, where `rms` is the
    /// root of the mean square plus `epsilon`.
    pub fn rms_rows(x: &[f32], scale: &[f32], shift: &[f32], epsilon: f32, out: &mut [f32]) {
        let width = scale.len();
        for (row, out) in x.chunks_exact(width).zip(out.chunks_exact_mut(width)) {
            let mean_square = sum(row, |x| x * x) / width as f32;
            let inverse = 1.0 / (mean_square + epsilon).sqrt();
            for (((out, x), scale), shift) in out.iter_mut().zip(row).zip(scale).zip(shift) {
                *out = x * inverse * scale + shift;
            }
        }
    }
}

/// Returns `Σ f(x)`, summed in a fixed order.
#[inline(always)]
pub(crate) fn sum(row: &[f32], f: impl Fn(f32) -> f32) -> f32 {
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
