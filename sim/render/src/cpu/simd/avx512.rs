//! AVX-512 (F, BW, DQ, VL): one register per vector, and a mask register per mask.

use core::arch::x86_64::{
    _kand_mask16 as and_mask, _kandn_mask16 as andnot_mask, _kor_mask16 as or_mask,
    _mm256_load_si256 as load_half, _mm512_add_epi32 as add_epi32, _mm512_add_ps as add_ps,
    _mm512_and_si512 as and_si, _mm512_castps_si512 as castps_si, _mm512_castsi512_ps as castsi_ps,
    _mm512_cmpeq_epi32_mask as cmpeq_epi32, _mm512_cmpgt_epi32_mask as cmpgt_epi32,
    _mm512_cvtepi16_epi32 as cvtepi16_epi32, _mm512_cvtepi32_ps as cvtepi32_ps,
    _mm512_cvtps_epi32 as cvtps_epi32, _mm512_cvttps_epi32 as cvttps_epi32, _mm512_div_ps as div_ps,
    _mm512_fmadd_ps as fmadd_ps, _mm512_load_ps as load_ps, _mm512_load_si512 as load_si,
    _mm512_madd_epi16 as madd_epi16, _mm512_max_epi32 as max_epi32, _mm512_max_ps as max_ps,
    _mm512_min_epi32 as min_epi32, _mm512_min_ps as min_ps, _mm512_mul_ps as mul_ps,
    _mm512_mullo_epi16 as mullo_epi16, _mm512_mullo_epi32 as mullo_epi32, _mm512_or_si512 as or_si,
    _mm512_set1_epi32 as set1_epi32, _mm512_set1_ps as set1_ps, _mm512_sll_epi32 as sll_epi32,
    _mm512_sqrt_ps as sqrt_ps, _mm512_sra_epi32 as sra_epi32, _mm512_srl_epi16 as srl_epi16,
    _mm512_srl_epi32 as srl_epi32, _mm512_store_ps as store_ps, _mm512_store_si512 as store_si,
    _mm512_sub_epi32 as sub_epi32, _mm512_sub_ps as sub_ps, *,
};

use super::each::each;
use super::permute512;
use super::registers::{intrinsic, methods, operator, shift, vectors};
use super::{
    Broadcast, F32x16, FloatLike, I16x16, I32x16, N_LANES, Simd, SimdF32, SimdI32, SimdMask, load_pairs,
};

/// The AVX-512 implementation.
#[derive(Clone, Copy)]
pub(crate) struct Avx512;

vectors! { Avx512, 1 registers, Avx512F32 of __m512, Avx512I32 of __m512i, Avx512Mask of __mmask16, also {
    #[inline(always)]
    fn load_partial(from: &[i32], rest: i32) -> Self {
        let n = from.len().min(N_LANES);
        let there = ((1_u32 << n) - 1) as u16;
        // The mask suppresses reads beyond the slice.
        Self([intrinsic!(_mm512_mask_loadu_epi32(_mm512_set1_epi32(rest), there, from.as_ptr()))])
    }

    #[inline(always)]
    fn reduce_min_u16(self) -> [u16; 2] {
        let min = intrinsic!({
            let eight =
                _mm256_min_epu16(_mm512_castsi512_si256(self.0[0]), _mm512_extracti64x4_epi64::<1>(self.0[0]));
            let four = _mm_min_epu16(_mm256_castsi256_si128(eight), _mm256_extracti128_si256::<1>(eight));
            let two = _mm_min_epu16(four, _mm_shuffle_epi32::<0b0100_1110>(four));
            _mm_cvtsi128_si32(_mm_min_epu16(two, _mm_shuffle_epi32::<0b1011_0001>(two)))
        });
        [min as u16, (min >> 16) as u16]
    }

    #[inline(always)]
    fn reduce_max(self) -> i32 {
        intrinsic!(_mm512_reduce_max_epi32(self.0[0]))
    }
} }

#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
fn cmpgt_ps(a: __m512, b: __m512) -> __mmask16 {
    _mm512_cmp_ps_mask::<_CMP_GT_OQ>(a, b)
}

#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
fn blend_ps(unset: __m512, set: __m512, mask: __mmask16) -> __m512 {
    _mm512_mask_blend_ps(mask, unset, set)
}

#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
fn blend_epi32(unset: __m512i, set: __m512i, mask: __mmask16) -> __m512i {
    _mm512_mask_blend_epi32(mask, unset, set)
}

#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
fn mask_to_bits(mask: __mmask16) -> u16 {
    mask
}

#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
fn mask_from_bits(bits: u16) -> __mmask16 {
    bits
}

impl Simd for Avx512 {
    type F = Avx512F32;
    type I = Avx512I32;
    type M = Avx512Mask;

    #[inline(always)]
    fn transpose(rows: [Avx512F32; N_LANES]) -> [Avx512F32; N_LANES] {
        let mut pairs = [rows[0].0[0]; N_LANES];
        let mut quads = pairs;
        let mut halves = pairs;
        let mut columns = rows;
        intrinsic!({
            for i in (0..N_LANES).step_by(2) {
                pairs[i] = _mm512_unpacklo_ps(rows[i].0[0], rows[i + 1].0[0]);
                pairs[i + 1] = _mm512_unpackhi_ps(rows[i].0[0], rows[i + 1].0[0]);
            }
            for i in (0..N_LANES).step_by(4) {
                quads[i] = _mm512_shuffle_ps::<0x44>(pairs[i], pairs[i + 2]);
                quads[i + 1] = _mm512_shuffle_ps::<0xEE>(pairs[i], pairs[i + 2]);
                quads[i + 2] = _mm512_shuffle_ps::<0x44>(pairs[i + 1], pairs[i + 3]);
                quads[i + 3] = _mm512_shuffle_ps::<0xEE>(pairs[i + 1], pairs[i + 3]);
            }
            // Each quad holds columns k, k + 4, k + 8, k + 12 of four rows, one per 128 bits.
            for k in 0..4 {
                halves[k] = _mm512_shuffle_f32x4::<0x88>(quads[k], quads[k + 4]);
                halves[k + 4] = _mm512_shuffle_f32x4::<0xDD>(quads[k], quads[k + 4]);
                halves[k + 8] = _mm512_shuffle_f32x4::<0x88>(quads[k + 8], quads[k + 12]);
                halves[k + 12] = _mm512_shuffle_f32x4::<0xDD>(quads[k + 8], quads[k + 12]);
            }
            for k in 0..4 {
                columns[k] = Avx512F32([_mm512_shuffle_f32x4::<0x88>(halves[k], halves[k + 8])]);
                columns[k + 4] = Avx512F32([_mm512_shuffle_f32x4::<0x88>(halves[k + 4], halves[k + 12])]);
                columns[k + 8] = Avx512F32([_mm512_shuffle_f32x4::<0xDD>(halves[k], halves[k + 8])]);
                columns[k + 12] = Avx512F32([_mm512_shuffle_f32x4::<0xDD>(halves[k + 4], halves[k + 12])]);
            }
        });
        columns
    }

    #[inline(always)]
    fn gather_pairs(words: &[u32], at: &I32x16) -> (Avx512I32, Avx512I32) {
        // Measured: sixteen loads take about half as long as gather instructions.
        let p = load_pairs::<Self>(words, at);
        intrinsic!({
            let low = _mm512_setr_epi64(p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7]);
            let high = _mm512_setr_epi64(p[8], p[9], p[10], p[11], p[12], p[13], p[14], p[15]);
            let even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
            let odd = _mm512_or_si512(even, _mm512_set1_epi32(1));
            (
                Avx512I32([_mm512_permutex2var_epi32(low, even, high)]),
                Avx512I32([_mm512_permutex2var_epi32(low, odd, high)]),
            )
        })
    }

    #[inline(always)]
    fn gather_window(
        words: &[u32],
        first: usize,
        pitch: usize,
        [x, y]: [Avx512I32; 2],
    ) -> Option<[Avx512I32; 4]> {
        let words = intrinsic!(permute512::of_words(words, first, pitch, [x.0[0], y.0[0]]))?;
        Some(each!(k in 4 => Avx512I32([words[k]])))
    }

    #[inline(always)]
    fn gather_window_u16(
        halves: &[u16],
        first: usize,
        pitch: usize,
        [x, y]: [Avx512I32; 2],
    ) -> Option<[Avx512I32; 2]> {
        let halves = intrinsic!(permute512::of_halves(halves, first, pitch, [x.0[0], y.0[0]]))?;
        Some(each!(k in 2 => Avx512I32([halves[k]])))
    }

    #[inline(always)]
    fn interleave_tiles([a, b, c, d]: [Avx512I32; 4]) -> [Avx512I32; 4] {
        intrinsic!({
            // One pixel row each, with the quarters of the four tiles side by side.
            let rows = [
                _mm512_unpacklo_epi64(a.0[0], b.0[0]),
                _mm512_unpackhi_epi64(a.0[0], b.0[0]),
                _mm512_unpacklo_epi64(c.0[0], d.0[0]),
                _mm512_unpackhi_epi64(c.0[0], d.0[0]),
            ];
            let upper = [
                _mm512_shuffle_i32x4::<0x44>(rows[0], rows[1]),
                _mm512_shuffle_i32x4::<0xEE>(rows[0], rows[1]),
            ];
            let lower = [
                _mm512_shuffle_i32x4::<0x44>(rows[2], rows[3]),
                _mm512_shuffle_i32x4::<0xEE>(rows[2], rows[3]),
            ];
            [
                Avx512I32([_mm512_shuffle_i32x4::<0x88>(upper[0], lower[0])]),
                Avx512I32([_mm512_shuffle_i32x4::<0xDD>(upper[0], lower[0])]),
                Avx512I32([_mm512_shuffle_i32x4::<0x88>(upper[1], lower[1])]),
                Avx512I32([_mm512_shuffle_i32x4::<0xDD>(upper[1], lower[1])]),
            ]
        })
    }

    #[inline(always)]
    fn compress(numbers: Avx512I32, keep: Avx512Mask, to: &mut [i32; N_LANES]) -> usize {
        intrinsic!({
            let kept = _mm512_maskz_compress_epi32(keep.0[0], numbers.0[0]);
            _mm512_storeu_si512(to.as_mut_ptr().cast(), kept);
        });
        keep.0[0].count_ones() as usize
    }

    #[inline(always)]
    fn store_rgb(pixels: Avx512I32, rows: [&mut [u8; 12]; 4]) {
        let [a, b, c, d] = rows;
        let bytes = intrinsic!(permute512::pack_rgb(pixels.0[0]));
        intrinsic!({
            _mm_mask_storeu_epi32(a.as_mut_ptr().cast(), 0b0111, _mm512_castsi512_si128(bytes));
            _mm_mask_storeu_epi32(b.as_mut_ptr().cast(), 0b0111, _mm512_extracti32x4_epi32::<1>(bytes));
            _mm_mask_storeu_epi32(c.as_mut_ptr().cast(), 0b0111, _mm512_extracti32x4_epi32::<2>(bytes));
            _mm_mask_storeu_epi32(d.as_mut_ptr().cast(), 0b0111, _mm512_extracti32x4_epi32::<3>(bytes));
        });
    }

    #[inline(always)]
    fn store_rgb_x4(pixels: [Avx512I32; 4], rows: [&mut [u8; 48]; 4]) {
        let [a, b, c, d] = each!(k in 4 => intrinsic!(permute512::pack_rgb(pixels[k].0[0])));
        let [first, second, third, fourth] = rows;
        intrinsic!({
            let (ab, cd) = (_mm512_shuffle_i32x4::<0x44>(a, b), _mm512_shuffle_i32x4::<0x44>(c, d));
            let (ab_low, cd_low) = (_mm512_shuffle_i32x4::<0xEE>(a, b), _mm512_shuffle_i32x4::<0xEE>(c, d));
            let by_row = [
                _mm512_shuffle_i32x4::<0x88>(ab, cd),
                _mm512_shuffle_i32x4::<0xDD>(ab, cd),
                _mm512_shuffle_i32x4::<0x88>(ab_low, cd_low),
                _mm512_shuffle_i32x4::<0xDD>(ab_low, cd_low),
            ];
            let close = _mm512_setr_epi32(0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, 0, 0, 0, 0);
            let [e, f, g, h] = each!(k in 4 => _mm512_permutexvar_epi32(close, by_row[k]));
            _mm512_mask_storeu_epi32(first.as_mut_ptr().cast(), 0x0FFF, e);
            _mm512_mask_storeu_epi32(second.as_mut_ptr().cast(), 0x0FFF, f);
            _mm512_mask_storeu_epi32(third.as_mut_ptr().cast(), 0x0FFF, g);
            _mm512_mask_storeu_epi32(fourth.as_mut_ptr().cast(), 0x0FFF, h);
        });
    }
}
