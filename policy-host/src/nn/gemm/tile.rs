//! Micro-kernels of the f32 GEMMs: the innermost loop, over one tile of the output.
//!
//! Every value is a single chain of fused multiply-adds over `k`, in order, whatever the instruction set and
//! the height of the tile.

#[cfg(target_arch = "x86_64")]
use crate::nn::isa::{V3, V4};

/// Columns of a panel and of a micro-tile: four AVX-512 registers.
pub(crate) const NR: usize = 64;
/// Rows of a micro-tile. With four registers per row, its accumulators take 24 of AVX-512's 32 registers.
pub(crate) const MR: usize = 6;
/// Length of a block along `k`, so that a panel's block stays in the cache while all rows are computed.
pub(crate) const KC: usize = 256;

/// Steps along `k` by which the AVX-512 kernels prefetch the weights. A panel's block is larger than the L1
/// cache, and its lines arrive late without a hint: products of ACT's large layers took 5 to 23 % longer.
#[cfg(target_arch = "x86_64")]
const PREFETCH_STEPS: usize = 8;

/// GEMM micro-kernel: `out [height, NR] = (out if adds, else 0) + x [height, kc] · weights [kc, NR]`, with
/// rows `stride` apart in `x` and `out_stride` apart in `out`. A row of `x` consists of equal segments of
/// `segment.0` values each, `segment.1` apart.
///
/// # Safety
/// The processor must support the kernel's instruction set, the slices must cover all of these values, and
/// nothing else may access the rows of `out` meanwhile.
#[cfg(target_arch = "x86_64")]
pub(crate) type MicroKernel = unsafe fn(
    x: &[f32],
    stride: usize,
    segment: (usize, usize),
    weights: &[f32],
    out: *mut f32,
    out_stride: usize,
    adds: bool,
);

/// Returns the AVX-512 micro-kernels for 1 to [`MR`] rows. The token proves the instruction set.
#[cfg(target_arch = "x86_64")]
pub(crate) const fn micro_kernels_512(_: V4) -> [MicroKernel; MR] {
    [
        micro_kernel_512::<1>,
        micro_kernel_512::<2>,
        micro_kernel_512::<3>,
        micro_kernel_512::<4>,
        micro_kernel_512::<5>,
        micro_kernel_512::<6>,
    ]
}

/// Returns the AVX2 micro-kernels for 1 to [`MR`] rows. The token proves the instruction set.
#[cfg(target_arch = "x86_64")]
pub(crate) const fn micro_kernels_256(_: V3) -> [MicroKernel; MR] {
    [
        micro_kernel_256::<1>,
        micro_kernel_256::<2>,
        micro_kernel_256::<3>,
        micro_kernel_256::<4>,
        micro_kernel_256::<5>,
        micro_kernel_256::<6>,
    ]
}

/// Defines a micro-kernel. `$lanes` is the number of lanes of a register, `$across` the number of registers
/// per row, `$prefetches` whether the kernel prefetches the weights.
macro_rules! micro_kernel {
    ($name:ident, $features:literal, $lanes:literal, $across:literal, $prefetches:literal, $zero:ident, $load:ident, $all:ident, $fma:ident, $store:ident) => {
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = $features)]
        unsafe fn $name<const HEIGHT: usize>(
            x: &[f32],
            stride: usize,
            (segment_len, segment_stride): (usize, usize),
            weights: &[f32],
            out: *mut f32,
            out_stride: usize,
            adds: bool,
        ) {
            use core::arch::x86_64::{_MM_HINT_T0, _mm_prefetch, $all, $fma, $load, $store, $zero};
            let x = x.as_ptr();
            for first in (0..NR).step_by($across * $lanes) {
                // SAFETY: the caller guarantees `HEIGHT` rows of `kc` values in `x` and of `NR` values in
                // `out`.
                unsafe {
                    let out = out.add(first);
                    let mut sums = [[$zero(); $across]; HEIGHT];
                    if adds {
                        for (row, sums) in sums.iter_mut().enumerate() {
                            for (col, sum) in sums.iter_mut().enumerate() {
                                *sum = $load(out.add(row * out_stride + col * $lanes));
                            }
                        }
                    }
                    for (segment, weights) in weights.chunks_exact(segment_len * NR).enumerate() {
                        let x = x.add(segment * segment_stride);
                        for (step, from) in weights.chunks_exact(NR).enumerate() {
                            let mut line = [$zero(); $across];
                            for (col, weights) in line.iter_mut().enumerate() {
                                *weights = $load(from.as_ptr().add(first + col * $lanes));
                                if $prefetches {
                                    let ahead = PREFETCH_STEPS * NR + first + col * $lanes;
                                    _mm_prefetch::<_MM_HINT_T0>(from.as_ptr().wrapping_add(ahead).cast());
                                }
                            }
                            for (row, sums) in sums.iter_mut().enumerate() {
                                let x = $all(*x.add(row * stride + step));
                                for (sum, weights) in sums.iter_mut().zip(line) {
                                    *sum = $fma(x, weights, *sum);
                                }
                            }
                        }
                    }
                    for (row, sums) in sums.iter().enumerate() {
                        for (col, sum) in sums.iter().enumerate() {
                            $store(out.add(row * out_stride + col * $lanes), *sum);
                        }
                    }
                }
            }
        }
    };
}

#[rustfmt::skip]
micro_kernel!(micro_kernel_512, "avx512f", 16, 4, true, _mm512_setzero_ps, _mm512_loadu_ps, _mm512_set1_ps, _mm512_fmadd_ps, _mm512_storeu_ps);
// With six rows, the accumulators take 12 of AVX2's 16 registers.
#[rustfmt::skip]
micro_kernel!(micro_kernel_256, "avx2,fma", 8, 2, false, _mm256_setzero_ps, _mm256_loadu_ps, _mm256_set1_ps, _mm256_fmadd_ps, _mm256_storeu_ps);
