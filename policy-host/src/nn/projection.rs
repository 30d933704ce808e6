//! Linear layers of large networks, `y = x · Wᵀ + b`: the weights stay where they are stored, or are
//! quantised to 8 bits, and the threads of the current rayon pool share the columns of the product.

use rayon::prelude::*;

use super::Precision;
use super::gemm::matmul::Accum;
use super::gemm::quantised::{QUAD, QuantisedRows, QuantisedWeights, Segments, quantise_signed};
use super::gemm::shared::SharedOutput;
use super::gemm::stored::StoredWeights;
use crate::weights::StoredTensor;

/// Minimum number of output features for 8-bit weights.
const MIN_QUANTISED_FEATURES: usize = 32;
/// Panels of 8-bit weights that one thread computes at a time.
const PANELS_PER_JOB: usize = 2;

/// A linear layer, like PyTorch's `Linear`.
#[derive(Clone, Debug)]
pub struct Projection {
    weights: ProjectionWeights,
    /// `[out_features]`, or empty for a layer without bias.
    bias: Vec<f32>,
}

#[derive(Clone, Debug)]
enum ProjectionWeights {
    Stored(StoredWeights),
    Int8(QuantisedWeights),
}

impl Projection {
    /// Creates the layer from `weight [out_features, in_features]`, or a convolution's weight whose axes
    /// after the first are the input, and `bias [out_features]`. With [`Precision::Int8`], the weights are
    /// quantised if that makes the layer faster.
    ///
    /// # Panics
    /// If the bias has another length.
    #[must_use]
    pub fn new(weight: StoredTensor, bias: Option<Vec<f32>>, precision: Precision) -> Self {
        let weights = StoredWeights::new(weight);
        let bias = bias.unwrap_or_default();
        let (k, n) = (weights.k(), weights.n());
        assert!(bias.is_empty() || bias.len() == n, "a bias of {} entries for {n} features", bias.len());
        let quantises = precision == Precision::Int8 && n >= MIN_QUANTISED_FEATURES && k.is_multiple_of(QUAD);
        let weights = if quantises {
            let column = |col: usize, out: &mut [f32]| weights.tensor().read(col * k, out);
            ProjectionWeights::Int8(QuantisedWeights::from_columns(k, n, column))
        } else {
            ProjectionWeights::Stored(weights)
        };
        Self { weights, bias }
    }

    /// Returns the number of input features.
    #[must_use]
    pub fn in_features(&self) -> usize {
        match &self.weights {
            ProjectionWeights::Stored(weights) => weights.k(),
            ProjectionWeights::Int8(weights) => weights.k(),
        }
    }

    /// Returns the number of output features.
    #[must_use]
    pub fn out_features(&self) -> usize {
        match &self.weights {
            ProjectionWeights::Stored(weights) => weights.n(),
            ProjectionWeights::Int8(weights) => weights.n(),
        }
    }

    /// Computes `out [t, out_features] = x [t, in_features] · Wᵀ + b`.
    ///
    /// # Panics
    /// If the lengths do not match.
    pub fn forward(&self, x: &[f32], out: &mut [f32]) {
        let accum = if self.bias.is_empty() {
            Accum::Replace
        } else {
            out.par_chunks_exact_mut(self.bias.len()).for_each(|row| row.copy_from_slice(&self.bias));
            Accum::Add
        };
        match &self.weights {
            ProjectionWeights::Stored(weights) => weights.matmul(x, out, accum),
            ProjectionWeights::Int8(weights) => multiply_quantised(weights, x, out, accum),
        }
    }
}

/// Computes `out [t, n] = x [t, k] · weights` or `out += x · weights`, with every row of `x` quantised.
fn multiply_quantised(weights: &QuantisedWeights, x: &[f32], out: &mut [f32], accum: Accum) {
    let (k, n) = (weights.k(), weights.n());
    let n_rows = x.len() / k;
    assert_eq!((x.len(), out.len()), (n_rows * k, n_rows * n), "rows of a linear layer");
    let (mut quantised, mut row_scales) = (vec![0; n_rows * k], vec![0.0; n_rows]);
    let rows = quantised.par_chunks_exact_mut(k).zip(&mut row_scales).zip(x.par_chunks_exact(k));
    rows.for_each(|((quantised, scale), row)| quantise_signed(row, quantised, scale));
    let out = SharedOutput::new(out);
    let segments = Segments { count: 1, len: k, stride: 0 };
    let n_jobs = weights.n_panels().div_ceil(PANELS_PER_JOB);
    (0..n_jobs).into_par_iter().for_each(|job| {
        let panels = job * PANELS_PER_JOB..weights.n_panels().min((job + 1) * PANELS_PER_JOB);
        let emit = |idx: usize, first: usize, sums: &[i32]| {
            // SAFETY: only this thread computes the columns of these panels.
            let out = unsafe { out.at(idx * n + first, 1, n, sums.len()) };
            // SAFETY: as above; `at` has checked the length.
            let out = unsafe { std::slice::from_raw_parts_mut(out, sums.len()) };
            let columns = weights.scales()[first..].iter().zip(&weights.zero_point_corrections()[first..]);
            for ((out, &sum), (scale, correction)) in out.iter_mut().zip(sums).zip(columns) {
                let product = (sum - correction) as f32 * (row_scales[idx] * scale);
                *out = if accum == Accum::Add { *out + product } else { product };
            }
        };
        let rows = QuantisedRows { values: &quantised, segments, n_rows };
        weights.matmul_panels(panels, rows, |idx| idx * k, emit);
    });
}
