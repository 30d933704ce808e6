//! AVX2 and FMA: two registers per vector.

use core::arch::x86_64::*;
use core::ops::{Add, BitAnd, BitOr, Div, Mul, Sub};

use crate::cpu::simd::each::each;

use super::{
    Broadcast, F32x16, FloatLike, I16x16, I32x16, N_LANES, Simd, SimdF32, SimdI32, SimdMask, load_pairs,
};

/// The AVX2 implementation.
#[derive(Clone, Copy)]
pub(crate) struct Avx2;

/// Sixteen floats: lanes 0 to 7 and 8 to 15.
#[derive(Clone, Copy)]
pub(crate) struct Avx2F32([__m256; 2]);

/// Sixteen integers: lanes 0 to 7 and 8 to 15.
#[derive(Clone, Copy)]
pub(crate) struct Avx2I32([__m256i; 2]);

/// Sixteen booleans: all bits of a lane are set, or none.
#[derive(Clone, Copy)]
pub(crate) struct Avx2Mask([__m256i; 2]);

/// Evaluates an expression of intrinsics.
macro_rules! intrinsic {
    ($call:expr) => {
        // SAFETY: values of this type exist only in code compiled for AVX2 and FMA, which runs only on
        // processors that have them (see `super::isa`).
        unsafe { $call }
    };
}

/// Applies an intrinsic to both registers.
macro_rules! both {
    ($intrinsic:ident ( $($arg:expr),+ )) => {
        intrinsic!([
            $intrinsic($($arg[0]),+),
            $intrinsic($($arg[1]),+)
        ])
    };
}

macro_rules! operator {
    ($type:ident, $trait:ident, $method:ident, $intrinsic:ident) => {
        impl $trait for $type {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(both!($intrinsic(self.0, other.0)))
            }
        }
    };
}

operator!(Avx2F32, Add, add, _mm256_add_ps);
operator!(Avx2F32, Sub, sub, _mm256_sub_ps);
operator!(Avx2F32, Mul, mul, _mm256_mul_ps);
operator!(Avx2F32, Div, div, _mm256_div_ps);
operator!(Avx2I32, Add, add, _mm256_add_epi32);
operator!(Avx2I32, Sub, sub, _mm256_sub_epi32);
operator!(Avx2I32, BitAnd, bitand, _mm256_and_si256);
operator!(Avx2I32, BitOr, bitor, _mm256_or_si256);
operator!(Avx2Mask, BitAnd, bitand, _mm256_and_si256);
operator!(Avx2Mask, BitOr, bitor, _mm256_or_si256);

impl Simd for Avx2 {
    type F = Avx2F32;
    type I = Avx2I32;
    type M = Avx2Mask;

    #[inline(always)]
    fn transpose(rows: [Avx2F32; N_LANES]) -> [Avx2F32; N_LANES] {
        let mut columns = rows;
        for half in 0..2 {
            for from in [0, 8] {
                let mut tile = [rows[0].0[0]; 8];
                for i in 0..8 {
                    tile[i] = rows[from + i].0[half];
                }
                let tile = transpose_8x8(tile);
                for i in 0..8 {
                    columns[8 * half + i].0[from / 8] = tile[i];
                }
            }
        }
        columns
    }

    #[inline(always)]
    fn gather_pairs(words: &[u32], at: &I32x16) -> (Avx2I32, Avx2I32) {
        let p = load_pairs::<Self>(words, at);
        intrinsic!({
            let a = _mm256_castsi256_ps(_mm256_setr_epi64x(p[0], p[1], p[2], p[3]));
            let b = _mm256_castsi256_ps(_mm256_setr_epi64x(p[4], p[5], p[6], p[7]));
            let c = _mm256_castsi256_ps(_mm256_setr_epi64x(p[8], p[9], p[10], p[11]));
            let d = _mm256_castsi256_ps(_mm256_setr_epi64x(p[12], p[13], p[14], p[15]));
            (
                Avx2I32([ordered(_mm256_shuffle_ps::<0x88>(a, b)), ordered(_mm256_shuffle_ps::<0x88>(c, d))]),
                Avx2I32([ordered(_mm256_shuffle_ps::<0xDD>(a, b)), ordered(_mm256_shuffle_ps::<0xDD>(c, d))]),
            )
        })
    }

    #[inline(always)]
    fn interleave_tiles([a, b, c, d]: [Avx2I32; 4]) -> [Avx2I32; 4] {
        intrinsic!({
            // Per register: one pixel row each, with the quarters of two tiles side by side.
            let rows = each!(i in 2 => [
                _mm256_unpacklo_epi64(a.0[i], b.0[i]),
                _mm256_unpackhi_epi64(a.0[i], b.0[i]),
                _mm256_unpacklo_epi64(c.0[i], d.0[i]),
                _mm256_unpackhi_epi64(c.0[i], d.0[i]),
            ]);
            let [[even, odd], [later_even, later_odd]] = each!(i in 2 => [
                Avx2I32([
                    _mm256_permute2x128_si256::<0x20>(rows[i][0], rows[i][1]),
                    _mm256_permute2x128_si256::<0x20>(rows[i][2], rows[i][3]),
                ]),
                Avx2I32([
                    _mm256_permute2x128_si256::<0x31>(rows[i][0], rows[i][1]),
                    _mm256_permute2x128_si256::<0x31>(rows[i][2], rows[i][3]),
                ]),
            ]);
            [even, odd, later_even, later_odd]
        })
    }

    #[inline(always)]
    fn store_rgb(pixels: Avx2I32, rows: [&mut [u8; 12]; 4]) {
        let [a, b, c, d] = rows;
        intrinsic!({
            let three_of_four = _mm256_broadcastsi128_si256(_mm_setr_epi8(
                0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, -1, -1, -1, -1,
            ));
            let [upper, lower] = each!(i in 2 => _mm256_shuffle_epi8(pixels.0[i], three_of_four));
            let three = _mm_setr_epi32(-1, -1, -1, 0);
            _mm_maskstore_epi32(a.as_mut_ptr().cast(), three, _mm256_castsi256_si128(upper));
            _mm_maskstore_epi32(b.as_mut_ptr().cast(), three, _mm256_extracti128_si256::<1>(upper));
            _mm_maskstore_epi32(c.as_mut_ptr().cast(), three, _mm256_castsi256_si128(lower));
            _mm_maskstore_epi32(d.as_mut_ptr().cast(), three, _mm256_extracti128_si256::<1>(lower));
        });
    }
}

/// Restores the lane order after shuffles that work within 128-bit halves.
#[inline(always)]
fn ordered(mixed: __m256) -> __m256i {
    intrinsic!(_mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_castps_si256(mixed)))
}

#[inline(always)]
fn transpose_8x8(rows: [__m256; 8]) -> [__m256; 8] {
    let (mut pairs, mut quads, mut columns) = (rows, rows, rows);
    intrinsic!({
        for i in (0..8).step_by(2) {
            pairs[i] = _mm256_unpacklo_ps(rows[i], rows[i + 1]);
            pairs[i + 1] = _mm256_unpackhi_ps(rows[i], rows[i + 1]);
        }
        for i in (0..8).step_by(4) {
            quads[i] = _mm256_shuffle_ps::<0x44>(pairs[i], pairs[i + 2]);
            quads[i + 1] = _mm256_shuffle_ps::<0xEE>(pairs[i], pairs[i + 2]);
            quads[i + 2] = _mm256_shuffle_ps::<0x44>(pairs[i + 1], pairs[i + 3]);
            quads[i + 3] = _mm256_shuffle_ps::<0xEE>(pairs[i + 1], pairs[i + 3]);
        }
        for k in 0..4 {
            columns[k] = _mm256_permute2f128_ps::<0x20>(quads[k], quads[k + 4]);
            columns[k + 4] = _mm256_permute2f128_ps::<0x31>(quads[k], quads[k + 4]);
        }
    });
    columns
}

impl FloatLike for Avx2F32 {
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self(intrinsic!([_mm256_set1_ps(x); 2]))
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        Self(both!(_mm256_fmadd_ps(self.0, factor.0, term.0)))
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(both!(_mm256_sqrt_ps(self.0)))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(both!(_mm256_max_ps(self.0, other.0)))
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(both!(_mm256_min_ps(self.0, other.0)))
    }
}

impl Broadcast<Avx2> for Avx2F32 {
    #[inline(always)]
    fn broadcast(self) -> Self {
        self
    }
}

impl SimdF32 for Avx2F32 {
    type I = Avx2I32;
    type M = Avx2Mask;

    #[inline(always)]
    fn load(from: &F32x16) -> Self {
        let half = |i: usize| from.0[i..i + 8].as_ptr();
        Self(intrinsic!([_mm256_load_ps(half(0)), _mm256_load_ps(half(8))]))
    }

    #[inline(always)]
    fn load_i16(from: &I16x16) -> Self {
        Self(each!(i in 2 => intrinsic!({
            let short = _mm_load_si128(from.0.as_ptr().add(i * 8).cast());
            _mm256_cvtepi32_ps(_mm256_cvtepi16_epi32(short))
        })))
    }

    #[inline(always)]
    fn store(self, to: &mut F32x16) {
        for (half, lanes) in self.0.into_iter().zip(to.0.chunks_exact_mut(8)) {
            intrinsic!(_mm256_store_ps(lanes.as_mut_ptr(), half));
        }
    }

    #[inline(always)]
    fn gt(self, other: Self) -> Avx2Mask {
        Avx2Mask(each!(i in 2 =>
            intrinsic!(_mm256_castps_si256(_mm256_cmp_ps::<_CMP_GT_OQ>(self.0[i], other.0[i])))))
    }

    #[inline(always)]
    fn select_or(self, mask: Avx2Mask, other: Self) -> Self {
        Self(each!(i in 2 =>
            intrinsic!(_mm256_blendv_ps(other.0[i], self.0[i], _mm256_castsi256_ps(mask.0[i])))))
    }

    #[inline(always)]
    fn round_to_i32(self) -> Avx2I32 {
        Avx2I32(both!(_mm256_cvtps_epi32(self.0)))
    }

    #[inline(always)]
    fn truncate_to_i32(self) -> Avx2I32 {
        Avx2I32(both!(_mm256_cvttps_epi32(self.0)))
    }

    #[inline(always)]
    fn bitcast_i32(self) -> Avx2I32 {
        Avx2I32(both!(_mm256_castps_si256(self.0)))
    }
}

impl SimdI32 for Avx2I32 {
    type F = Avx2F32;
    type M = Avx2Mask;

    #[inline(always)]
    fn splat(x: i32) -> Self {
        Self(intrinsic!([_mm256_set1_epi32(x); 2]))
    }

    #[inline(always)]
    fn load(from: &I32x16) -> Self {
        let half = |i: usize| from.0[i..i + 8].as_ptr().cast();
        Self(intrinsic!([_mm256_load_si256(half(0)), _mm256_load_si256(half(8))]))
    }

    #[inline(always)]
    fn store(self, to: &mut I32x16) {
        for (half, lanes) in self.0.into_iter().zip(to.0.chunks_exact_mut(8)) {
            intrinsic!(_mm256_store_si256(lanes.as_mut_ptr().cast(), half));
        }
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(both!(_mm256_mullo_epi32(self.0, other.0)))
    }

    #[inline(always)]
    fn mul_i16(self, other: Self) -> Self {
        Self(both!(_mm256_mullo_epi16(self.0, other.0)))
    }

    #[inline(always)]
    fn dot_i16(self, other: Self) -> Self {
        Self(both!(_mm256_madd_epi16(self.0, other.0)))
    }

    #[inline(always)]
    fn shl<const BITS: u32>(self) -> Self {
        let count = intrinsic!(_mm_cvtsi32_si128(BITS.cast_signed()));
        Self(each!(i in 2 => intrinsic!(_mm256_sll_epi32(self.0[i], count))))
    }

    #[inline(always)]
    fn shr_logical<const BITS: u32>(self) -> Self {
        let count = intrinsic!(_mm_cvtsi32_si128(BITS.cast_signed()));
        Self(each!(i in 2 => intrinsic!(_mm256_srl_epi32(self.0[i], count))))
    }

    #[inline(always)]
    fn shr_logical_u16<const BITS: u32>(self) -> Self {
        let count = intrinsic!(_mm_cvtsi32_si128(BITS.cast_signed()));
        Self(each!(i in 2 => intrinsic!(_mm256_srl_epi16(self.0[i], count))))
    }

    #[inline(always)]
    fn shr_arithmetic<const BITS: u32>(self) -> Self {
        self.shr_arithmetic_by(BITS)
    }

    #[inline(always)]
    fn shr_arithmetic_by(self, bits: u32) -> Self {
        let count = intrinsic!(_mm_cvtsi32_si128(bits.cast_signed()));
        Self(each!(i in 2 => intrinsic!(_mm256_sra_epi32(self.0[i], count))))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(both!(_mm256_max_epi32(self.0, other.0)))
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(both!(_mm256_min_epi32(self.0, other.0)))
    }

    #[inline(always)]
    fn gt(self, other: Self) -> Avx2Mask {
        Avx2Mask(both!(_mm256_cmpgt_epi32(self.0, other.0)))
    }

    #[inline(always)]
    fn eq(self, other: Self) -> Avx2Mask {
        Avx2Mask(both!(_mm256_cmpeq_epi32(self.0, other.0)))
    }

    #[inline(always)]
    fn select_or(self, mask: Avx2Mask, other: Self) -> Self {
        Self(both!(_mm256_blendv_epi8(other.0, self.0, mask.0)))
    }

    #[inline(always)]
    fn to_f32(self) -> Avx2F32 {
        Avx2F32(both!(_mm256_cvtepi32_ps(self.0)))
    }

    #[inline(always)]
    fn bitcast_f32(self) -> Avx2F32 {
        Avx2F32(both!(_mm256_castsi256_ps(self.0)))
    }
}

impl SimdMask for Avx2Mask {
    #[inline(always)]
    fn to_bits(self) -> u16 {
        let [low, high] =
            each!(i in 2 => intrinsic!(_mm256_movemask_ps(_mm256_castsi256_ps(self.0[i]))) as u16);
        low | high << 8
    }

    #[inline(always)]
    fn from_bits(bits: u16) -> Self {
        intrinsic!({
            let lane = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            Self(each!(i in 2 => {
                let here = _mm256_and_si256(_mm256_set1_epi32(i32::from(bits >> (8 * i))), lane);
                _mm256_cmpeq_epi32(here, lane)
            }))
        })
    }

    #[inline(always)]
    fn and_not(self, other: Self) -> Self {
        Self(both!(_mm256_andnot_si256(other.0, self.0)))
    }
}
