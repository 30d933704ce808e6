//! Linear layers, `y = x · Wᵀ + b` with PyTorch's weight layout.

use super::Precision;
use super::gemm::matmul::Accum;
use super::gemm::packed::PackedWeights;
use super::gemm::quantised::{QUAD, QuantisedWeights, Segments, quantise_signed};

/// Number of input values that are quantised together.
const QUANTISED_BLOCK_LEN: usize = 48 << 10;
/// Granularity of the number of rows that are quantised together: the rows of a GEMM micro-tile.
const QUANTISED_ROW_GRANULARITY: usize = 6;
/// Maximum number of rows that are quantised together.
const MAX_QUANTISED_ROWS: usize = 96;
/// Minimum `out_features` for 8-bit weights. Smaller layers take too little time to gain from them.
const MIN_QUANTISED_FEATURES: usize = 32;

/// A linear layer, like PyTorch's `Linear`.
#[derive(Clone, Debug)]
pub struct Linear {
    weights: LinearWeights,
    bias: Vec<f32>,
}

/// Transposed weights `[in_features, out_features]`.
#[derive(Clone, Debug)]
enum LinearWeights {
    F32(PackedWeights),
    Int8(QuantisedWeights),
}

impl Linear {
    /// Creates an f32 layer from `weight [out_features, in_features]` and `bias [out_features]`.
    ///
    /// # Panics
    /// If the lengths do not match.
    #[must_use]
    pub fn new(weight: &[f32], bias: &[f32]) -> Self {
        Self::with_precision(weight, bias, Precision::F32)
    }

    /// Like [`new`](Self::new), with the given precision. Layers that would not gain from 8 bits stay in f32.
    ///
    /// # Panics
    /// If the lengths do not match.
    #[must_use]
    pub fn with_precision(weight: &[f32], bias: &[f32], precision: Precision) -> Self {
        let out_features = bias.len();
        let in_features = weight.len() / out_features;
        assert_eq!(weight.len(), in_features * out_features, "weight [{out_features}, {in_features}]");
        let mut transposed = vec![0.0; weight.len()];
        for (out_idx, row) in weight.chunks_exact(in_features).enumerate() {
            for (in_idx, &x) in row.iter().enumerate() {
                transposed[in_idx * out_features + out_idx] = x;
            }
        }
        let is_quantised = precision == Precision::Int8
            && out_features >= MIN_QUANTISED_FEATURES
            && in_features.is_multiple_of(QUAD)
            && in_features <= QUANTISED_BLOCK_LEN / QUANTISED_ROW_GRANULARITY;
        let weights = if is_quantised {
            LinearWeights::Int8(QuantisedWeights::new(&transposed, in_features, out_features))
        } else {
            LinearWeights::F32(PackedWeights::new(&transposed, in_features, out_features))
        };
        Self { weights, bias: bias.to_vec() }
    }

    /// Returns the size of the weights in memory.
    #[must_use]
    pub fn weight_bytes(&self) -> usize {
        match &self.weights {
            LinearWeights::F32(weights) => weights.size_bytes(),
            LinearWeights::Int8(weights) => weights.size_bytes(),
        }
    }

    /// Returns the number of input features.
    #[must_use]
    pub fn in_features(&self) -> usize {
        match &self.weights {
            LinearWeights::F32(weights) => weights.k(),
            LinearWeights::Int8(weights) => weights.k(),
        }
    }

    /// Returns the number of output features.
    #[must_use]
    pub fn out_features(&self) -> usize {
        self.bias.len()
    }

    /// Computes `out [t, out_features] = x [t, in_features] · Wᵀ + b`.
    ///
    /// # Panics
    /// If the lengths do not match.
    pub fn forward(&self, x: &[f32], out: &mut [f32]) {
        out.chunks_exact_mut(self.out_features()).for_each(|row| row.copy_from_slice(&self.bias));
        self.accumulate(x, out);
    }

    /// Computes `out [t, out_features] += x [t, in_features] · Wᵀ + b`.
    ///
    /// # Panics
    /// If the lengths do not match.
    pub fn forward_add(&self, x: &[f32], out: &mut [f32]) {
        self.add_bias(out);
        self.accumulate(x, out);
    }

    /// Like [`forward_add`](Self::forward_add) for an input whose columns are stored as `n_blocks` separate
    /// blocks of equal width, such as attention heads: `block(i)` is `[t, in_features / n_blocks]`. The
    /// result is bit-identical.
    ///
    /// # Panics
    /// If the lengths do not match.
    pub fn forward_add_blocks<'a>(
        &self,
        n_blocks: usize,
        block: impl Fn(usize) -> &'a [f32],
        out: &mut [f32],
    ) {
        let width = self.in_features() / n_blocks;
        assert_eq!(self.in_features(), n_blocks * width, "the blocks must have equal width");
        self.add_bias(out);
        match &self.weights {
            LinearWeights::F32(weights) => (0..n_blocks).for_each(|idx| {
                weights.matmul_rows(idx * width..(idx + 1) * width, block(idx), width, out, Accum::Add);
            }),
            LinearWeights::Int8(weights) => add_quantised(weights, out, |row, input| {
                for (idx, part) in input.chunks_exact_mut(width).enumerate() {
                    part.copy_from_slice(&block(idx)[row * width..][..width]);
                }
            }),
        }
    }

    fn add_bias(&self, out: &mut [f32]) {
        for row in out.chunks_exact_mut(self.out_features()) {
            row.iter_mut().zip(&self.bias).for_each(|(y, b)| *y += b);
        }
    }

    fn accumulate(&self, x: &[f32], out: &mut [f32]) {
        let (in_features, out_features) = (self.in_features(), self.out_features());
        let n_rows = x.len() / in_features;
        assert_eq!(
            (x.len(), out.len()),
            (n_rows * in_features, n_rows * out_features),
            "rows of a linear layer"
        );
        match &self.weights {
            LinearWeights::F32(weights) => weights.matmul(x, in_features, out, Accum::Add),
            LinearWeights::Int8(weights) => {
                add_quantised(weights, out, |row, input| {
                    input.copy_from_slice(&x[row * in_features..][..in_features]);
                });
            }
        }
    }
}

/// Computes `out [t, n] += x · weights` with every row of `x` quantised. `copy(row, [k])` writes a row of
/// `x`.
fn add_quantised(weights: &QuantisedWeights, out: &mut [f32], copy: impl Fn(usize, &mut [f32])) {
    let (k, n) = (weights.k(), weights.n());
    let mut quantised = [0; QUANTISED_BLOCK_LEN];
    let mut input = [0.0; QUANTISED_BLOCK_LEN / QUANTISED_ROW_GRANULARITY];
    let mut scales = [0.0; MAX_QUANTISED_ROWS];
    let block_rows = QUANTISED_BLOCK_LEN / k / QUANTISED_ROW_GRANULARITY * QUANTISED_ROW_GRANULARITY;
    let block_rows = block_rows.min(MAX_QUANTISED_ROWS);
    for (block_idx, out) in out.chunks_mut(block_rows * n).enumerate() {
        let n_rows = out.len() / n;
        for (idx, (row, scale)) in quantised.chunks_exact_mut(k).zip(&mut scales).take(n_rows).enumerate() {
            copy(block_idx * block_rows + idx, &mut input[..k]);
            quantise_signed(&input[..k], row, scale);
        }
        let segments = Segments { count: 1, len: k, stride: 0 };
        weights.matmul(
            &quantised,
            segments,
            n_rows,
            |idx| idx * k,
            |idx, first, sums| {
                let columns =
                    weights.scales()[first..].iter().zip(&weights.zero_point_corrections()[first..]);
                let out = out[idx * n + first..].iter_mut();
                for ((out, &sum), (scale, correction)) in out.zip(sums).zip(columns) {
                    *out += (sum - correction) as f32 * (scales[idx] * scale);
                }
            },
        );
    }
}

/// Returns `max(x, 0)`, but NaN for NaN: an overflow reaches the actions and is not taken for a number.
#[inline(always)]
pub(crate) fn rectified(x: f32) -> f32 {
    if x < 0.0 { 0.0 } else { x }
}

/// Applies `max(x, 0)` in place.
pub fn relu(x: &mut [f32]) {
    x.iter_mut().for_each(|x| *x = rectified(*x));
}
