//! Permutations of AVX-512 registers: gathers from 8 × 8 windows, sixteen points at a time, and packing of
//! pixels.

use core::arch::x86_64::*;

use crate::cpu::simd::each::each;

/// Returns `true` if all points lie within the first 7 × 7.
///
/// # Safety
/// The processor must have AVX-512.
#[inline(always)]
unsafe fn all_in_window([x, y]: [__m512i; 2]) -> bool {
    // SAFETY: guaranteed by the caller.
    unsafe { _mm512_cmpgt_epu32_mask(_mm512_max_epu32(x, y), _mm512_set1_epi32(6)) == 0 }
}

/// Implements [`super::Simd::gather_window`].
///
/// # Safety
/// The processor must have AVX-512.
#[inline(always)]
pub(crate) unsafe fn of_words(
    words: &[u32],
    first: usize,
    pitch: usize,
    [x, y]: [__m512i; 2],
) -> Option<[__m512i; 4]> {
    // SAFETY: the caller guarantees AVX-512, and all rows lie within the slice.
    unsafe {
        if !all_in_window([x, y]) {
            return None;
        }
        let words = &words[first..][..7 * pitch + 8];
        let rows = each!(i in 4 => {
            let upper = _mm256_loadu_si256(words.as_ptr().add(2 * i * pitch).cast());
            let lower = _mm256_loadu_si256(words.as_ptr().add((2 * i + 1) * pitch).cast());
            _mm512_inserti64x4::<1>(_mm512_castsi256_si512(upper), lower)
        });
        let at = _mm512_add_epi32(_mm512_slli_epi32::<3>(y), x);
        let below = _mm512_add_epi32(at, _mm512_set1_epi32(8));
        let one = _mm512_set1_epi32(1);
        // Indices from 32 on are in the bottom half of the window.
        let lower = _mm512_set1_epi32(32);
        let halves = [_mm512_test_epi32_mask(at, lower), _mm512_test_epi32_mask(below, lower)];
        let places = [at, _mm512_add_epi32(at, one), below, _mm512_add_epi32(below, one)];
        Some(each!(k in 4 => {
            let above = _mm512_permutex2var_epi32(rows[0], places[k], rows[1]);
            let under = _mm512_permutex2var_epi32(rows[2], places[k], rows[3]);
            _mm512_mask_mov_epi32(above, halves[k / 2], under)
        }))
    }
}

/// Implements [`super::Simd::gather_window_u16`].
///
/// # Safety
/// The processor must have AVX-512.
#[inline(always)]
pub(crate) unsafe fn of_halves(
    halves: &[u16],
    first: usize,
    pitch: usize,
    [x, y]: [__m512i; 2],
) -> Option<[__m512i; 2]> {
    // SAFETY: the caller guarantees AVX-512, and all rows lie within the slice.
    unsafe {
        if !all_in_window([x, y]) {
            return None;
        }
        let halves = &halves[first..][..7 * pitch + 8];
        let [upper, lower] = each!(k in 2 => {
            let [a, b, c, d] = each!(i in 4 => _mm_loadu_si128(halves.as_ptr().add((4 * k + i) * pitch).cast()));
            let first = _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(a), b);
            let second = _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(c), d);
            _mm512_inserti64x4::<1>(_mm512_castsi256_si512(first), second)
        });
        let at = _mm512_add_epi32(_mm512_slli_epi32::<3>(y), x);
        // The index in both 16-bit halves; the high half is incremented below.
        let two = _mm512_or_si512(at, _mm512_slli_epi32::<16>(at));
        let places = [
            _mm512_add_epi32(two, _mm512_set1_epi32(0x0001_0000)),
            _mm512_add_epi32(two, _mm512_set1_epi32(0x0009_0008)),
        ];
        Some(each!(k in 2 => _mm512_permutex2var_epi16(upper, places[k], lower)))
    }
}

/// Packs the low three bytes of each lane contiguously within every four lanes.
///
/// # Safety
/// The processor must have AVX-512.
#[inline(always)]
pub(crate) unsafe fn pack_rgb(pixels: __m512i) -> __m512i {
    // SAFETY: guaranteed by the caller.
    unsafe {
        let order = _mm_setr_epi8(0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, -1, -1, -1, -1);
        _mm512_shuffle_epi8(pixels, _mm512_broadcast_i32x4(order))
    }
}
