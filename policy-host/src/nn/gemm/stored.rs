//! GEMM with weights that stay where they are stored, typically in a memory-mapped file.
//!
//! `packed` keeps a second copy of all weights; a network of billions of parameters has no room for it. Here
//! each block of a panel is converted to f32 and transposed just before it is multiplied with all rows of the
//! input. With 50 rows or more this costs little, and the products are the same chains of fused
//! multiply-adds.

use std::array;

use half::f16;
use rayon::prelude::*;

use super::matmul::Accum;
use super::shared::SharedOutput;
use super::tile::{KC, NR};
#[cfg(target_arch = "x86_64")]
use super::tile::{MR, MicroKernel, micro_kernels_256, micro_kernels_512};
use crate::nn::isa::FloatIsa;
use crate::weights::{FloatType, StoredTensor};

/// Weights `[n, k]` of a linear layer in PyTorch's layout.
#[derive(Clone, Debug)]
pub(crate) struct StoredWeights {
    tensor: StoredTensor,
    k: usize,
    n: usize,
    isa: FloatIsa,
}

/// A block `[kc, NR]` of a panel in f32, zero beyond the last column.
#[repr(C, align(64))]
struct PanelBlock([f32; KC * NR]);

impl StoredWeights {
    /// Wraps a tensor whose first axis is the output. Its other axes together are the input.
    pub(crate) fn new(tensor: StoredTensor) -> Self {
        Self::with_isa(tensor, FloatIsa::best())
    }

    fn with_isa(tensor: StoredTensor, isa: FloatIsa) -> Self {
        let n = tensor.shape()[0];
        let k = tensor.shape()[1..].iter().product();
        Self { tensor, k, n, isa }
    }

    /// Returns the number of input features `k`.
    pub(crate) fn k(&self) -> usize {
        self.k
    }

    /// Returns the number of output features `n`.
    pub(crate) fn n(&self) -> usize {
        self.n
    }

    /// Returns the tensor `[n, k]`.
    pub(crate) fn tensor(&self) -> &StoredTensor {
        &self.tensor
    }

    /// Computes `out [m, n] = x [m, k] · Wᵀ` or `out += x · Wᵀ`, with the panels shared among the threads of
    /// the current rayon pool.
    ///
    /// # Panics
    /// If the lengths do not match.
    pub(crate) fn matmul(&self, x: &[f32], out: &mut [f32], accum: Accum) {
        let n_rows = out.len() / self.n;
        assert_eq!((out.len(), x.len()), (n_rows * self.n, n_rows * self.k), "rows of a linear layer");
        let out = SharedOutput::new(out);
        // Rows that are far apart would miss the cache and the translation of addresses.
        let mut packed = if self.k > KC { vec![0.0; n_rows * KC] } else { Vec::new() };
        for k_start in (0..self.k).step_by(KC) {
            let kc = KC.min(self.k - k_start);
            let block = if self.k > KC {
                let rows = packed.par_chunks_exact_mut(kc).zip(x.par_chunks_exact(self.k)).with_min_len(64);
                rows.for_each(|(packed, row)| packed.copy_from_slice(&row[k_start..k_start + kc]));
                &packed[..n_rows * kc]
            } else {
                x
            };
            let adds = k_start > 0 || accum == Accum::Add;
            let panels = (0..self.n.div_ceil(NR)).into_par_iter();
            panels
                .for_each(|panel| self.multiply_panel(panel * NR, (block, kc, k_start), n_rows, &out, adds));
        }
    }

    /// Computes the product of the rows `x [n_rows, kc]` and a panel, of inputs from `k_start`.
    fn multiply_panel(
        &self,
        first: usize,
        (x, kc, k_start): (&[f32], usize, usize),
        n_rows: usize,
        out: &SharedOutput<'_>,
        adds: bool,
    ) {
        let n_cols = NR.min(self.n - first);
        let mut panel = PanelBlock([0.0; KC * NR]);
        self.load(first, n_cols, k_start, &mut panel.0[..kc * NR]);
        let columns = PanelColumns { first, n_cols, n_rows, weights: &panel.0[..kc * NR], adds };
        match self.isa {
            FloatIsa::Portable => self.multiply_block_portable(&columns, x, out),
            #[cfg(target_arch = "x86_64")]
            FloatIsa::Fma256(token) => self.multiply_block(&columns, x, out, &micro_kernels_256(token)),
            #[cfg(target_arch = "x86_64")]
            FloatIsa::Fma512(token) => self.multiply_block(&columns, x, out, &micro_kernels_512(token)),
        }
    }

    /// Converts and transposes the weights of `n_cols` columns from `first`, inputs from `k_start`.
    fn load(&self, first: usize, n_cols: usize, k_start: usize, block: &mut [f32]) {
        let bytes = self.tensor.bytes();
        let kc = block.len() / NR;
        match self.tensor.float_type() {
            FloatType::F32 => {
                let row = |col: usize| &bytes[((first + col) * self.k + k_start) * 4..][..kc * 4];
                transpose(n_cols, |col| row(col).as_chunks::<4>().0, |x| f32::from_le_bytes(*x), block);
            }
            FloatType::Bf16 => {
                let row = |col: usize| &bytes[((first + col) * self.k + k_start) * 2..][..kc * 2];
                let widen = |x: &[u8; 2]| f32::from_bits(u32::from(u16::from_le_bytes(*x)) << 16);
                transpose(n_cols, |col| row(col).as_chunks::<2>().0, widen, block);
            }
            FloatType::F16 => {
                let row = |col: usize| &bytes[((first + col) * self.k + k_start) * 2..][..kc * 2];
                let widen = |x: &[u8; 2]| f16::from_le_bytes(*x).to_f32();
                transpose(n_cols, |col| row(col).as_chunks::<2>().0, widen, block);
            }
        }
    }

    fn multiply_block_portable(&self, columns: &PanelColumns<'_>, x: &[f32], out: &SharedOutput<'_>) {
        let &PanelColumns { first, n_cols, n_rows, weights, adds } = columns;
        let kc = weights.len() / NR;
        for row in 0..n_rows {
            // SAFETY: only this thread computes the columns of this panel.
            let out = unsafe { out.at(row * self.n + first, 1, self.n, n_cols) };
            // SAFETY: as above; `at` has checked the length.
            let out = unsafe { std::slice::from_raw_parts_mut(out, n_cols) };
            let mut sums = [0.0; NR];
            if adds {
                sums[..n_cols].copy_from_slice(out);
            }
            for (x, weights) in x[row * kc..][..kc].iter().zip(weights.as_chunks::<NR>().0) {
                sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += x * weight);
            }
            out.copy_from_slice(&sums[..n_cols]);
        }
    }

    #[cfg(target_arch = "x86_64")]
    fn multiply_block(
        &self,
        columns: &PanelColumns<'_>,
        x: &[f32],
        out: &SharedOutput<'_>,
        micro_kernels: &[MicroKernel; MR],
    ) {
        let &PanelColumns { first, n_cols, n_rows, weights, adds } = columns;
        let kc = weights.len() / NR;
        for row in (0..n_rows).step_by(MR) {
            let height = MR.min(n_rows - row);
            let x = &x[row * kc..][..height * kc];
            // SAFETY: only this thread computes the columns of this panel.
            let out = unsafe { out.at(row * self.n + first, height, self.n, n_cols) };
            let micro_kernel = micro_kernels[height - 1];
            if n_cols == NR {
                // SAFETY: `at` has checked the rows of `out`, and `micro_kernels` was selected with the token
                // of its instruction set.
                unsafe { micro_kernel(x, kc, (kc, 0), weights, out, self.n, adds) };
                continue;
            }
            let mut full = [0.0; MR * NR];
            // SAFETY: `at` has checked `height` rows of `n_cols` values, and `full` has as many full rows.
            unsafe {
                for (idx, full) in full.chunks_exact_mut(NR).take(height).enumerate() {
                    full[..n_cols].copy_from_slice(std::slice::from_raw_parts(out.add(idx * self.n), n_cols));
                }
                micro_kernel(x, kc, (kc, 0), weights, full.as_mut_ptr(), NR, adds);
                for (idx, full) in full.chunks_exact(NR).take(height).enumerate() {
                    std::slice::from_raw_parts_mut(out.add(idx * self.n), n_cols)
                        .copy_from_slice(&full[..n_cols]);
                }
            }
        }
    }
}

/// The columns of a panel within one block along `k`.
struct PanelColumns<'a> {
    first: usize,
    n_cols: usize,
    n_rows: usize,
    /// Weights `[kc, NR]`.
    weights: &'a [f32],
    adds: bool,
}

/// Writes the `n_cols` rows `row(col) [kc]` as the columns of `block [kc, NR]`.
fn transpose<'a, T: 'a>(
    n_cols: usize,
    row: impl Fn(usize) -> &'a [T],
    widen: impl Fn(&T) -> f32,
    block: &mut [f32],
) {
    /// PanelColumns that are written together: one cache line.
    const GROUP: usize = 16;
    let mut col = 0;
    while col + GROUP <= n_cols {
        let rows: [&[T]; GROUP] = array::from_fn(|idx| row(col + idx));
        for (idx, line) in block.chunks_exact_mut(NR).enumerate() {
            for (x, row) in line[col..col + GROUP].iter_mut().zip(rows) {
                *x = widen(&row[idx]);
            }
        }
        col += GROUP;
    }
    for col in col..n_cols {
        block.chunks_exact_mut(NR).zip(row(col)).for_each(|(line, x)| line[col] = widen(x));
    }
}
