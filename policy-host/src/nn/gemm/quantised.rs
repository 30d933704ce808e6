//! GEMM with 8-bit integers and 32-bit accumulators: less exact than f32, and faster on processors with VNNI.
//!
//! Weights are quantised symmetrically to ±127 with one scale per output column. Inputs are quantised
//! dynamically, with one scale per row or image. Integer sums are exact, so every processor gives the same
//! bits. AVX-512 VNNI computes 64 products per instruction; without it, this path is slower than f32.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

#[cfg(target_arch = "x86_64")]
use crate::nn::isa::Avx512Vnni;
use crate::nn::isa::{Int8Isa, multiversion};

/// Columns of a panel and of a micro-tile: four AVX-512 registers.
const NR: usize = 64;
/// Rows of a micro-tile. With four registers per row, its accumulators take 24 of AVX-512's 32 registers.
const MR: usize = 6;
/// Number of products that one 32-bit lane sums per instruction. `k` must be a multiple of it.
pub(crate) const QUAD: usize = 4;
/// Largest quantised magnitude of weights and signed inputs.
const SIGNED_MAX: f32 = 127.0;
/// Largest quantised value of non-negative inputs.
const UNSIGNED_MAX: f32 = 255.0;
/// Zero point of signed inputs, which are stored as u8.
const ZERO_POINT: u8 = 128;
/// 2²³. Adding it to a float rounds to the nearest integer and leaves that integer in the low bits of the
/// mantissa.
const ROUNDING_OFFSET: f32 = 8_388_608.0;

/// One cache line of weights.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(64))]
struct AlignedI8x64([i8; 64]);

/// Quantised and packed weights `[k, n]`.
#[derive(Clone, Debug)]
pub(crate) struct QuantisedWeights {
    /// Panels `[⌈n / NR⌉, k / QUAD, NR, QUAD] i8`, zero beyond the last column.
    panels: Vec<AlignedI8x64>,
    k: usize,
    n: usize,
    /// Quantisation scale `[n]` of each column.
    scales: Vec<f32>,
    /// Zero-point correction `[n]`: column sum times [`ZERO_POINT`], to be subtracted from sums over signed
    /// inputs.
    zero_point_corrections: Vec<i32>,
    isa: Int8Isa,
}

/// Memory layout of an input row: `count` contiguous segments of `len` values, `stride` values apart.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Segments {
    pub(crate) count: usize,
    pub(crate) len: usize,
    pub(crate) stride: usize,
}

/// Rows of quantised inputs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct QuantisedRows<'a> {
    pub(crate) values: &'a [u8],
    pub(crate) segments: Segments,
    pub(crate) n_rows: usize,
}

impl QuantisedWeights {
    /// Quantises and packs row-major weights `[k, n]`.
    ///
    /// # Panics
    /// If `weights` does not have this shape, or `k` is not a multiple of [`QUAD`].
    pub(crate) fn new(weights: &[f32], k: usize, n: usize) -> Self {
        Self::with_isa(weights, k, n, Int8Isa::best())
    }

    fn with_isa(weights: &[f32], k: usize, n: usize, isa: Int8Isa) -> Self {
        assert_eq!(weights.len(), k * n, "weights [{k}, {n}]");
        let column = |col: usize, out: &mut [f32]| {
            out.iter_mut().zip(weights.iter().skip(col).step_by(n)).for_each(|(out, x)| *out = *x);
        };
        Self { isa, ..Self::from_columns(k, n, column) }
    }

    /// Quantises and packs weights `[k, n]`, of which `column(col, [k])` writes a column. The threads of the
    /// current rayon pool share the panels.
    ///
    /// # Panics
    /// If `k` is not a multiple of [`QUAD`].
    pub(crate) fn from_columns(k: usize, n: usize, column: impl Fn(usize, &mut [f32]) + Sync) -> Self {
        assert!(k.is_multiple_of(QUAD), "k = {k} must be a multiple of {QUAD}");
        let mut panels = vec![AlignedI8x64::zeroed(); n.div_ceil(NR) * k];
        let (mut scales, mut zero_point_corrections) = (vec![0.0; n], vec![0; n]);
        let jobs = panels.par_chunks_exact_mut(k).zip(scales.par_chunks_mut(NR));
        let jobs = jobs.zip(zero_point_corrections.par_chunks_mut(NR)).enumerate();
        jobs.for_each(|(panel_idx, ((panel, scales), corrections))| {
            let panel: &mut [i8] = bytemuck::cast_slice_mut(panel);
            let mut values = vec![0.0; k];
            for (col, (scale, correction)) in scales.iter_mut().zip(corrections).enumerate() {
                column(panel_idx * NR + col, &mut values);
                *scale = values.iter().fold(0.0, |max: f32, x| max.max(x.abs())) / SIGNED_MAX;
                let mut sum = 0;
                for (idx, x) in values.iter().enumerate() {
                    let quantised = if *scale > 0.0 { (x / *scale).round() as i8 } else { 0 };
                    panel[(idx / QUAD * NR + col) * QUAD + idx % QUAD] = quantised;
                    sum += i32::from(quantised);
                }
                *correction = i32::from(ZERO_POINT) * sum;
            }
        });
        Self { panels, k, n, scales, zero_point_corrections, isa: Int8Isa::best() }
    }

    /// Returns the number of panels of up to [`NR`] columns.
    pub(crate) fn n_panels(&self) -> usize {
        self.n.div_ceil(NR)
    }

    /// Returns the number of rows `k` of the weights.
    pub(crate) fn k(&self) -> usize {
        self.k
    }

    /// Returns the size of the packed weights in memory.
    pub(crate) fn size_bytes(&self) -> usize {
        size_of_val(&*self.panels)
    }

    /// Returns the number of columns `n` of the weights.
    pub(crate) fn n(&self) -> usize {
        self.n
    }

    /// Returns the quantisation scale `[n]` of each column.
    pub(crate) fn scales(&self) -> &[f32] {
        &self.scales
    }

    /// Returns the zero-point correction `[n]`, to be subtracted from sums over signed inputs.
    pub(crate) fn zero_point_corrections(&self) -> &[i32] {
        &self.zero_point_corrections
    }

    /// Multiplies `n_rows` rows of quantised inputs with the weights. Row `idx` starts at `start(idx)` in
    /// `inputs`. Calls `emit(idx, first column, accumulators)` with up to [`NR`] columns at a time.
    ///
    /// # Panics
    /// If the segments do not add up to `k` values, or a row would end outside `inputs`.
    pub(crate) fn matmul(
        &self,
        inputs: &[u8],
        segments: Segments,
        n_rows: usize,
        start: impl Fn(usize) -> usize,
        emit: impl FnMut(usize, usize, &[i32]),
    ) {
        let rows = QuantisedRows { values: inputs, segments, n_rows };
        self.matmul_panels(0..self.n_panels(), rows, start, emit);
    }

    /// Like [`matmul`](Self::matmul), for the columns of these panels.
    ///
    /// # Panics
    /// See [`matmul`](Self::matmul).
    pub(crate) fn matmul_panels(
        &self,
        panels: Range<usize>,
        rows: QuantisedRows<'_>,
        start: impl Fn(usize) -> usize,
        emit: impl FnMut(usize, usize, &[i32]),
    ) {
        let segments = rows.segments;
        assert_eq!(segments.count * segments.len, self.k, "{segments:?}");
        assert!(segments.len.is_multiple_of(QUAD), "{segments:?}");
        match self.isa {
            Int8Isa::Portable => {
                self.matmul_tiled(panels, rows, start, emit, &MICRO_KERNELS_PORTABLE);
            }
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the token proves AVX-512F and VNNI.
            Int8Isa::Vnni(token) => unsafe {
                self.matmul_vnni(token, panels, rows, start, emit);
            },
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vnni")]
    fn matmul_vnni(
        &self,
        token: Avx512Vnni,
        panels: Range<usize>,
        rows: QuantisedRows<'_>,
        start: impl Fn(usize) -> usize,
        emit: impl FnMut(usize, usize, &[i32]),
    ) {
        self.matmul_tiled(panels, rows, start, emit, &micro_kernels_vnni(token));
    }

    #[inline(always)]
    fn matmul_tiled(
        &self,
        panels: Range<usize>,
        rows: QuantisedRows<'_>,
        start: impl Fn(usize) -> usize,
        mut emit: impl FnMut(usize, usize, &[i32]),
        micro_kernels: &[Int8MicroKernel; MR],
    ) {
        let QuantisedRows { values: inputs, segments, n_rows } = rows;
        let row_extent = (segments.count - 1) * segments.stride + segments.len;
        let packed: &[i8] = bytemuck::cast_slice(&self.panels);
        let mut sums = [0; MR * NR];
        for panel_idx in panels {
            let panel = &packed[panel_idx * self.k * NR..][..self.k * NR];
            let first = panel_idx * NR;
            let n_cols = NR.min(self.n - first);
            for row in (0..n_rows).step_by(MR) {
                let height = MR.min(n_rows - row);
                let mut rows: [&[u8]; MR] = [&[]; MR];
                for (idx, input) in rows[..height].iter_mut().enumerate() {
                    *input = &inputs[start(row + idx)..][..row_extent];
                }
                // SAFETY: the first `height` rows extend to the end of the last segment, the panel has as
                // many rows as the segments have values, and `micro_kernels` was selected with the token of
                // its instruction set.
                unsafe { micro_kernels[height - 1](&rows, segments, panel, &mut sums) };
                for (idx, sums) in sums.chunks_exact(NR).take(height).enumerate() {
                    emit(row + idx, first, &sums[..n_cols]);
                }
            }
        }
    }
}

multiversion! {
    /// Quantises non-negative values to 0 to 255 and sets `scale`. The scale is not finite if any value is
    /// not.
    pub(crate) fn quantise_unsigned(values: &[f32], out: &mut [u8], scale: &mut f32) {
        *scale = quantise(values, UNSIGNED_MAX, ROUNDING_OFFSET, out);
    }

    /// Quantises values to [`ZERO_POINT`] ± 127 and sets `scale`. The scale is not finite if any value is
    /// not.
    pub(crate) fn quantise_signed(values: &[f32], out: &mut [u8], scale: &mut f32) {
        *scale = quantise(values, SIGNED_MAX, ROUNDING_OFFSET + f32::from(ZERO_POINT), out);
    }
}

/// Quantises values to integers of magnitude up to `q_max` and returns the scale. `offset` is
/// [`ROUNDING_OFFSET`] plus the zero point.
#[inline(always)]
fn quantise(values: &[f32], q_max: f32, offset: f32, out: &mut [u8]) -> f32 {
    assert_eq!(values.len(), out.len(), "quantised values");
    let magnitude = |x: &f32| x.to_bits() & 0x7fff_ffff;
    // The bits of magnitudes, compared as integers, have the order of the floats, with NaN above all.
    let max = f32::from_bits(values.iter().fold(0, |max, x| max.max(magnitude(x))));
    let inverse_scale = if max > 0.0 { q_max / max } else { 0.0 };
    for (out, x) in out.iter_mut().zip(values) {
        *out = (x * inverse_scale + offset).to_bits() as u8;
    }
    max / q_max
}

/// Accumulators `[MR, NR]` of a micro-tile.
type Accumulators = [i32; MR * NR];

/// GEMM micro-kernel: computes `sums [height, NR]`, the product of the first `height` rows and a panel.
///
/// # Safety
/// The processor must support the kernel's instruction set, the rows must extend to the end of the last
/// segment, and the panel must have as many rows as the segments have values.
type Int8MicroKernel =
    unsafe fn(rows: &[&[u8]; MR], segments: Segments, panel: &[i8], sums: &mut Accumulators);

/// Portable micro-kernels for 1 to [`MR`] rows.
const MICRO_KERNELS_PORTABLE: [Int8MicroKernel; MR] = [
    micro_kernel_portable::<1>,
    micro_kernel_portable::<2>,
    micro_kernel_portable::<3>,
    micro_kernel_portable::<4>,
    micro_kernel_portable::<5>,
    micro_kernel_portable::<6>,
];

/// Returns the VNNI micro-kernels for 1 to [`MR`] rows. The token proves the instruction set.
#[cfg(target_arch = "x86_64")]
const fn micro_kernels_vnni(_: Avx512Vnni) -> [Int8MicroKernel; MR] {
    [
        micro_kernel_vnni::<1>,
        micro_kernel_vnni::<2>,
        micro_kernel_vnni::<3>,
        micro_kernel_vnni::<4>,
        micro_kernel_vnni::<5>,
        micro_kernel_vnni::<6>,
    ]
}

fn micro_kernel_portable<const HEIGHT: usize>(
    rows: &[&[u8]; MR],
    segments: Segments,
    panel: &[i8],
    sums: &mut Accumulators,
) {
    for (row, sums) in rows[..HEIGHT].iter().zip(sums.chunks_exact_mut(NR)) {
        sums.fill(0);
        let mut lines = panel.chunks_exact(NR * QUAD);
        for segment in 0..segments.count {
            let inputs = row[segment * segments.stride..][..segments.len].as_chunks::<QUAD>().0;
            for (inputs, line) in inputs.iter().zip(&mut lines) {
                for (sum, weights) in sums.iter_mut().zip(line.as_chunks::<QUAD>().0) {
                    let products = inputs.iter().zip(weights).map(|(&x, &w)| i32::from(x) * i32::from(w));
                    *sum += products.sum::<i32>();
                }
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vnni")]
unsafe fn micro_kernel_vnni<const HEIGHT: usize>(
    rows: &[&[u8]; MR],
    segments: Segments,
    panel: &[i8],
    out: &mut Accumulators,
) {
    use core::arch::x86_64::{
        _mm512_dpbusd_epi32, _mm512_loadu_si512, _mm512_set1_epi32, _mm512_setzero_si512, _mm512_storeu_si512,
    };
    const ACROSS: usize = NR / 16;
    let mut sums = [[_mm512_setzero_si512(); ACROSS]; HEIGHT];
    let mut weights = panel.as_ptr();
    for segment in 0..segments.count {
        let first = segment * segments.stride;
        for idx in (first..first + segments.len).step_by(QUAD) {
            // SAFETY: the caller guarantees `HEIGHT` rows that extend to the end of the last segment, and
            // `NR` groups of weights for each group of four inputs.
            unsafe {
                let mut line = [_mm512_setzero_si512(); ACROSS];
                for (col, line) in line.iter_mut().enumerate() {
                    *line = _mm512_loadu_si512(weights.add(col * 64).cast());
                }
                weights = weights.add(NR * QUAD);
                for (row, sums) in rows.iter().zip(&mut sums) {
                    let x = _mm512_set1_epi32(row.as_ptr().add(idx).cast::<i32>().read_unaligned());
                    for (sum, weights) in sums.iter_mut().zip(line) {
                        *sum = _mm512_dpbusd_epi32(*sum, x, weights);
                    }
                }
            }
        }
    }
    for (sums, out) in sums.iter().zip(out.chunks_exact_mut(NR)) {
        for (sum, out) in sums.iter().zip(out.chunks_exact_mut(16)) {
            // SAFETY: `out` has sixteen elements.
            unsafe { _mm512_storeu_si512(out.as_mut_ptr().cast(), *sum) };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pseudo_random(n: usize, salt: usize) -> Vec<f32> {
        (0..n).map(|i| ((i * 7919 + salt * 104_729) % 2003) as f32 / 1001.0 - 1.0).collect()
    }

    #[test]
    fn every_instruction_set_gives_exact_integer_sums() {
        for (n_rows, n, count, len, stride) in
            [(1, 1, 1, 4, 0), (5, 7, 3, 12, 20), (13, 130, 2, 64, 100), (50, 64, 1, 516, 0)]
        {
            let k = count * len;
            let weights = pseudo_random(k * n, 2);
            let bytes: Vec<u8> = (0..(n_rows - 1) * 8 + (count - 1) * stride + len)
                .map(|i| if i % 5 == 0 { 255 } else { (i * 37 % 256) as u8 })
                .collect();
            for isa in Int8Isa::available() {
                let matrix = QuantisedWeights::with_isa(&weights, k, n, isa);
                let mut n_emitted = 0;
                matrix.matmul(
                    &bytes,
                    Segments { count, len, stride },
                    n_rows,
                    |row| row * 8,
                    |row, first, sums| {
                        for (col, &found) in (first..).zip(sums) {
                            let input_offset = |idx: usize| idx / len * stride + idx % len;
                            let expected: f64 = (0..k)
                                .map(|idx| {
                                    let weight = (weights[idx * n + col] / matrix.scales()[col]).round();
                                    f64::from(bytes[row * 8 + input_offset(idx)]) * f64::from(weight)
                                })
                                .sum();
                            assert_eq!(f64::from(found), expected, "{isa:?} row {row} column {col}");
                            n_emitted += 1;
                        }
                    },
                );
                assert_eq!(n_emitted, n_rows * n, "{isa:?}");
            }
        }
    }

    #[test]
    fn values_are_quantised_to_nearest() {
        let (mut out, mut scale) = ([0; 5], 0.0);
        quantise_signed(&[-2.54, -0.011, 0.0, 0.009, 1.0], &mut out, &mut scale);
        assert_eq!((out, scale), ([1, 127, 128, 128, 178], 0.02));
        quantise_unsigned(&[0.0, 0.6, 1.4, 255.0, 128.0], &mut out, &mut scale);
        assert_eq!((out, scale), ([0, 1, 1, 255, 128], 1.0));
        quantise_signed(&[0.0; 5], &mut out, &mut scale);
        assert_eq!((out, scale), ([ZERO_POINT; 5], 0.0));
    }

    #[test]
    fn non_finite_values_give_a_non_finite_scale() {
        let (mut out, mut scale) = ([0; 3], 0.0);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            quantise_signed(&[1.0, bad, -2.0], &mut out, &mut scale);
            assert!(!scale.is_finite());
        }
    }
}
