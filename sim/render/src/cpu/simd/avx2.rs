//! AVX2 and FMA: two registers per vector, for lanes 0 to 7 and 8 to 15. All bits of a mask's lane are set,
//! or none.

use core::arch::x86_64::{
    _mm_load_si128 as load_half, _mm256_add_epi32 as add_epi32, _mm256_add_ps as add_ps,
    _mm256_and_si256 as and_si, _mm256_and_si256 as and_mask, _mm256_andnot_si256 as andnot_mask,
    _mm256_blendv_epi8 as blend_epi32, _mm256_castps_si256 as castps_si, _mm256_castsi256_ps as castsi_ps,
    _mm256_cmpeq_epi32 as cmpeq_epi32, _mm256_cmpgt_epi32 as cmpgt_epi32,
    _mm256_cvtepi16_epi32 as cvtepi16_epi32, _mm256_cvtepi32_ps as cvtepi32_ps,
    _mm256_cvtps_epi32 as cvtps_epi32, _mm256_cvttps_epi32 as cvttps_epi32, _mm256_div_ps as div_ps,
    _mm256_fmadd_ps as fmadd_ps, _mm256_load_ps as load_ps, _mm256_load_si256 as load_si,
    _mm256_madd_epi16 as madd_epi16, _mm256_max_epi32 as max_epi32, _mm256_max_ps as max_ps,
    _mm256_min_epi32 as min_epi32, _mm256_min_ps as min_ps, _mm256_mul_ps as mul_ps,
    _mm256_mullo_epi16 as mullo_epi16, _mm256_mullo_epi32 as mullo_epi32, _mm256_or_si256 as or_si,
    _mm256_or_si256 as or_mask, _mm256_set1_epi32 as set1_epi32, _mm256_set1_ps as set1_ps,
    _mm256_sll_epi32 as sll_epi32, _mm256_sqrt_ps as sqrt_ps, _mm256_sra_epi32 as sra_epi32,
    _mm256_srl_epi16 as srl_epi16, _mm256_srl_epi32 as srl_epi32, _mm256_store_ps as store_ps,
    _mm256_store_si256 as store_si, _mm256_sub_epi32 as sub_epi32, _mm256_sub_ps as sub_ps, *,
};

use super::each::each;
use super::registers::{intrinsic, methods, operator, shift, vectors};
use super::{
    Broadcast, F32x16, FloatLike, I16x16, I32x16, N_LANES, Simd, SimdF32, SimdI32, SimdMask, load_pairs,
};

/// The AVX2 implementation.
#[derive(Clone, Copy)]
pub(crate) struct Avx2;

vectors! { Avx2, 2 registers, Avx2F32 of __m256, Avx2I32 of __m256i, Avx2Mask of __m256i, also {} }

#[inline]
#[target_feature(enable = "avx2,fma")]
fn cmpgt_ps(a: __m256, b: __m256) -> __m256i {
    castps_si(_mm256_cmp_ps::<_CMP_GT_OQ>(a, b))
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn blend_ps(unset: __m256, set: __m256, mask: __m256i) -> __m256 {
    _mm256_blendv_ps(unset, set, castsi_ps(mask))
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn mask_to_bits(mask: __m256i) -> u16 {
    _mm256_movemask_ps(castsi_ps(mask)) as u16
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn mask_from_bits(bits: u16) -> __m256i {
    let lane = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
    cmpeq_epi32(and_si(set1_epi32(i32::from(bits)), lane), lane)
}

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
