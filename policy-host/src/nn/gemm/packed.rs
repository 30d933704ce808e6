//! GEMM with packed weights: `[m, k] · [k, n]`, where the right factor is packed once into panels of `NR`
//! columns.
//!
//! faer packs both factors in every call. The weights are the same in every query, so packing them once saves
//! that work: 1.2 to 1.5 times as fast as faer 0.24 at ACT's shapes, measured in one run with AVX-512 by
//! `cargo bench -p benches --bench policy`.
//!
//! Every value of a product is a single chain of fused multiply-adds over `k`, in order, whatever the
//! instruction set, the micro-tile or the number of rows. It has the same bits on every x86 processor with
//! FMA. Without FMA, products are rounded as well.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use super::matmul::Accum;
use super::quantised::Segments;
use super::tile::NR;
#[cfg(target_arch = "x86_64")]
use super::tile::{KC, MR, MicroKernel, micro_kernels_256, micro_kernels_512};
use crate::nn::isa::FloatIsa;

/// Values of one AVX-512 register, aligned so that no load crosses a cache line.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
struct AlignedF32x16([f32; 16]);

/// Packed weights `[k, n] f32`.
#[derive(Clone, Debug)]
pub struct PackedWeights {
    /// Panels `[⌈n / NR⌉, k, NR]`, zero beyond the last column.
    panels: Vec<AlignedF32x16>,
    k: usize,
    n: usize,
    isa: FloatIsa,
}

impl PackedWeights {
    /// Packs row-major weights `[k, n]`.
    ///
    /// # Panics
    /// If `weights` does not have this shape.
    #[must_use]
    pub fn new(weights: &[f32], k: usize, n: usize) -> Self {
        Self::with_isa(weights, k, n, FloatIsa::best())
    }

    fn with_isa(weights: &[f32], k: usize, n: usize, isa: FloatIsa) -> Self {
        assert_eq!(weights.len(), k * n, "weights [{k}, {n}]");
        let n_panels = n.div_ceil(NR);
        let mut panels = vec![AlignedF32x16::zeroed(); n_panels * k * NR / 16];
        let packed: &mut [f32] = bytemuck::cast_slice_mut(&mut panels);
        for (panel_idx, panel) in packed.chunks_exact_mut(k * NR).enumerate() {
            let first = panel_idx * NR;
            let n_cols = NR.min(n - first);
            for (line, row) in panel.chunks_exact_mut(NR).zip(weights.chunks_exact(n)) {
                line[..n_cols].copy_from_slice(&row[first..first + n_cols]);
            }
        }
        Self { panels, k, n, isa }
    }

    /// Returns the number of rows `k` of the weights.
    #[must_use]
    pub fn k(&self) -> usize {
        self.k
    }

    /// Returns the size of the packed weights in memory.
    #[must_use]
    pub fn size_bytes(&self) -> usize {
        size_of_val(&*self.panels)
    }

    /// Returns the number of columns `n` of the weights.
    #[must_use]
    pub fn n(&self) -> usize {
        self.n
    }

    /// Computes `out [m, n] = x [m, k] · weights` or `out += x · weights`. Rows of `x` are `stride` values
    /// apart and may overlap.
    ///
    /// # Panics
    /// If `out` is not a whole number of rows, or the last row of `x` would end outside the slice.
    pub fn matmul(&self, x: &[f32], stride: usize, out: &mut [f32], accum: Accum) {
        self.matmul_rows(0..self.k, x, stride, out, accum);
    }

    /// Like [`matmul`](Self::matmul) with only the rows `k_range` of the weights: `x` is `[m,
    /// k_range.len()]`.
    ///
    /// # Panics
    /// If `k_range` exceeds the weights, `out` is not a whole number of rows, or the last row of `x` would
    /// end outside the slice.
    pub fn matmul_rows(
        &self,
        k_range: Range<usize>,
        x: &[f32],
        stride: usize,
        out: &mut [f32],
        accum: Accum,
    ) {
        let n_rows = out.len() / self.n;
        assert_eq!(out.len(), n_rows * self.n, "rows of {} values", self.n);
        assert!(k_range.end <= self.k, "rows {k_range:?} of {}", self.k);
        if n_rows == 0 {
            return;
        }
        assert!(
            (n_rows - 1) * stride + k_range.len() <= x.len(),
            "{n_rows} rows of {} values",
            k_range.len()
        );
        match self.isa {
            FloatIsa::Portable => self.matmul_portable(k_range, x, stride, out, accum),
            #[cfg(target_arch = "x86_64")]
            FloatIsa::Fma256(token) => {
                self.matmul_tiled(k_range, x, stride, out, accum, &micro_kernels_256(token));
            }
            #[cfg(target_arch = "x86_64")]
            FloatIsa::Fma512(token) => {
                self.matmul_tiled(k_range, x, stride, out, accum, &micro_kernels_512(token));
            }
        }
    }

    /// Computes `out [m, n] = x [m, k] · weights`, where each row of `x` consists of `segments`, which
    /// together have `k` values. Rows of `x` start `stride` values apart and may overlap. The sums have the
    /// same bits as those of [`matmul`](Self::matmul) with the segments copied together.
    ///
    /// # Panics
    /// If the segments do not have `k` values, `out` is not a whole number of rows, or the last row of `x`
    /// would end outside the slice.
    pub(crate) fn matmul_segments(&self, x: &[f32], stride: usize, segments: Segments, out: &mut [f32]) {
        assert_eq!(segments.count * segments.len, self.k, "{segments:?}");
        let n_rows = out.len() / self.n;
        assert_eq!(out.len(), n_rows * self.n, "rows of {} values", self.n);
        #[cfg(target_arch = "x86_64")]
        if self.k <= KC && n_rows > 0 {
            let extent = (segments.count - 1) * segments.stride + segments.len;
            assert!((n_rows - 1) * stride + extent <= x.len(), "{n_rows} rows of {segments:?}");
            let micro_kernels = match self.isa {
                FloatIsa::Portable => None,
                FloatIsa::Fma256(token) => Some(micro_kernels_256(token)),
                FloatIsa::Fma512(token) => Some(micro_kernels_512(token)),
            };
            if let Some(micro_kernels) = micro_kernels {
                return self.matmul_block(0..self.k, x, (stride, segments), out, false, &micro_kernels);
            }
        }
        for idx in 0..segments.count {
            let accum = if idx == 0 { Accum::Replace } else { Accum::Add };
            let k_range = idx * segments.len..(idx + 1) * segments.len;
            self.matmul_rows(k_range, &x[idx * segments.stride..], stride, out, accum);
        }
    }

    /// Iterates over the panels with the index of their first column.
    fn panels(&self) -> impl Iterator<Item = (usize, &[f32])> {
        let values: &[f32] = bytemuck::cast_slice(&self.panels);
        values.chunks_exact(self.k * NR).enumerate().map(|(idx, panel)| (idx * NR, panel))
    }

    /// Computes one row at a time, so that no value depends on other rows.
    fn matmul_portable(
        &self,
        k_range: Range<usize>,
        x: &[f32],
        stride: usize,
        out: &mut [f32],
        accum: Accum,
    ) {
        for (row, out) in out.chunks_exact_mut(self.n).enumerate() {
            let x = &x[row * stride..][..k_range.len()];
            for (first, panel) in self.panels() {
                let out = &mut out[first..self.n.min(first + NR)];
                let mut sums = [0.0; NR];
                if accum == Accum::Add {
                    sums[..out.len()].copy_from_slice(out);
                }
                let weights = panel[k_range.start * NR..k_range.end * NR].as_chunks::<NR>().0;
                for (x, weights) in x.iter().zip(weights) {
                    sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += x * weight);
                }
                out.copy_from_slice(&sums[..out.len()]);
            }
        }
    }

    #[cfg(target_arch = "x86_64")]
    fn matmul_tiled(
        &self,
        k_range: Range<usize>,
        x: &[f32],
        stride: usize,
        out: &mut [f32],
        accum: Accum,
        micro_kernels: &[MicroKernel; MR],
    ) {
        for k_start in (0..k_range.len()).step_by(KC) {
            let kc = KC.min(k_range.len() - k_start);
            let adds = k_start > 0 || accum == Accum::Add;
            let block = k_range.start + k_start..k_range.start + k_start + kc;
            let segments = Segments { count: 1, len: kc, stride: 0 };
            self.matmul_block(block, &x[k_start..], (stride, segments), out, adds, micro_kernels);
        }
    }

    /// Multiplies with the rows `block` of the weights, at most [`KC`] of them.
    #[cfg(target_arch = "x86_64")]
    fn matmul_block(
        &self,
        block: Range<usize>,
        x: &[f32],
        (stride, segments): (usize, Segments),
        out: &mut [f32],
        adds: bool,
        micro_kernels: &[MicroKernel; MR],
    ) {
        let n_rows = out.len() / self.n;
        let extent = (segments.count - 1) * segments.stride + segments.len;
        let segment = (segments.len, segments.stride);
        for (first, panel) in self.panels() {
            let weights = &panel[block.start * NR..block.end * NR];
            let n_cols = NR.min(self.n - first);
            for row in (0..n_rows).step_by(MR) {
                let height = MR.min(n_rows - row);
                let x = &x[row * stride..][..(height - 1) * stride + extent];
                let out = &mut out[row * self.n + first..][..(height - 1) * self.n + n_cols];
                let micro_kernel = micro_kernels[height - 1];
                if n_cols == NR {
                    // SAFETY: the slices cover the micro-tile of `height` rows, and `micro_kernels` was
                    // selected with the token of its instruction set.
                    unsafe { micro_kernel(x, stride, segment, weights, out.as_mut_ptr(), self.n, adds) };
                } else {
                    let mut full = [0.0; MR * NR];
                    let rows = full.chunks_exact_mut(NR).zip(out.chunks(self.n));
                    rows.for_each(|(full, out)| full[..n_cols].copy_from_slice(&out[..n_cols]));
                    let rows = &mut full[..height * NR];
                    // SAFETY: as above; `rows` is `height` full rows of the micro-tile.
                    unsafe { micro_kernel(x, stride, segment, weights, rows.as_mut_ptr(), NR, adds) };
                    let rows = full.chunks_exact(NR).zip(out.chunks_mut(self.n));
                    rows.for_each(|(full, out)| out[..n_cols].copy_from_slice(&full[..n_cols]));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pseudo_random(n: usize, salt: usize) -> Vec<f32> {
        (0..n).map(|i| ((i * 7919 + salt * 104_729) % 2003) as f32 / 1001.0 - 1.0).collect()
    }

    /// Edge cases `(m, n, k)`: narrow, wide, partial panels, small k, k above a block, overlapping rows.
    const SHAPES: [(usize, usize, usize); 6] =
        [(1, 1, 1), (5, 7, 3), (6, 64, 256), (13, 130, 300), (50, 200, 513), (7, 16, 64)];

    fn product(isa: FloatIsa, (m, n, k): (usize, usize, usize), accum: Accum, stride: usize) -> Vec<f32> {
        let x = pseudo_random((m - 1) * stride + k, 1);
        let mut out = pseudo_random(m * n, 3);
        PackedWeights::with_isa(&pseudo_random(k * n, 2), k, n, isa).matmul(&x, stride, &mut out, accum);
        out
    }

    #[test]
    fn every_instruction_set_gives_the_fused_chain() {
        for shape in SHAPES {
            let (m, n, k) = shape;
            for (accum, stride) in [(Accum::Replace, k), (Accum::Add, k + 5), (Accum::Replace, k.div_ceil(3))]
            {
                let x = pseudo_random((m - 1) * stride + k, 1);
                let (weights, before) = (pseudo_random(k * n, 2), pseudo_random(m * n, 3));
                let chain = |i: usize| {
                    let first = if accum == Accum::Add { before[i] } else { 0.0 };
                    let row = &x[i / n * stride..][..k];
                    row.iter()
                        .enumerate()
                        .fold(first, |sum, (idx, x)| x.mul_add(weights[idx * n + i % n], sum))
                };
                let expected: Vec<f32> = (0..m * n).map(chain).collect();
                for isa in FloatIsa::available() {
                    let found = product(isa, shape, accum, stride);
                    if matches!(isa, FloatIsa::Portable) {
                        let error =
                            found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                        assert!(error < 1e-4, "{isa:?} {shape:?} {accum:?}: off by {error}");
                    } else {
                        assert!(found == expected, "{isa:?} {shape:?} {accum:?} stride {stride}");
                    }
                }
            }
        }
    }

    #[test]
    fn segments_give_the_bits_of_copied_rows() {
        for (n_rows, n, segments) in [
            (7, 64, Segments { count: 7, len: 21, stride: 90 }),
            (13, 70, Segments { count: 3, len: 8, stride: 70 }),
            (5, 16, Segments { count: 3, len: 200, stride: 250 }),
        ] {
            let (k, stride) = (segments.count * segments.len, 6);
            let x = pseudo_random((n_rows - 1) * stride + segments.count * segments.stride, 1);
            let weights = pseudo_random(k * n, 2);
            let rows: Vec<f32> = (0..n_rows * segments.count)
                .flat_map(|idx| {
                    let (row, segment) = (idx / segments.count, idx % segments.count);
                    x[row * stride + segment * segments.stride..][..segments.len].to_vec()
                })
                .collect();
            for isa in FloatIsa::available() {
                let packed = PackedWeights::with_isa(&weights, k, n, isa);
                let [mut found, mut expected] = [vec![f32::NAN; n_rows * n], vec![0.0; n_rows * n]];
                packed.matmul_segments(&x, stride, segments, &mut found);
                packed.matmul(&rows, k, &mut expected, Accum::Replace);
                assert!(found == expected, "{isa:?} {segments:?}");
            }
        }
    }

    #[test]
    #[should_panic(expected = "2 rows of 8 values")]
    fn matmul_panics_when_input_is_too_short() {
        PackedWeights::new(&[0.0; 16], 8, 2).matmul(&[0.0; 15], 8, &mut [0.0; 4], Accum::Replace);
    }
}
