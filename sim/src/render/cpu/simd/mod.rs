//! Sixteen numbers side by side and what can be done with them, once per instruction set.
//!
//! Every operation is the IEEE or integer one in each lane, the fused product-and-sum included, so generic code gives the
//! same bits on every instruction set. Values of an implementation exist only inside code compiled for its instruction
//! set ([`super::isa`]): that is what makes its intrinsics sound.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
pub(super) mod each;
pub(super) mod isa;
mod portable;
#[cfg(target_arch = "x86_64")]
mod windows;

use core::ops::{Add, BitAnd, BitOr, Div, Mul, Sub};

#[cfg(target_arch = "x86_64")]
pub(super) use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
pub(super) use avx512::Avx512;
pub(super) use portable::Portable;

pub(super) use crate::render::math::lanes::{F32x16, I16x16, I32x16, N_LANES};
use each::each;

/// An instruction set.
pub(super) trait Simd: Copy {
    /// `[16] f32`.
    type F: SimdF32<I = Self::I, M = Self::M> + Broadcast<Self>;
    /// `[16] i32`.
    type I: SimdI32<F = Self::F, M = Self::M>;
    /// `[16]` yes or no.
    type M: SimdMask;

    /// Rows become columns.
    fn transpose(rows: [Self::F; N_LANES]) -> [Self::F; N_LANES];

    /// The words at each index and right behind it. An index outside of `words` is a mistake, which builds with debug
    /// assertions tell; others then read some other words.
    ///
    /// # Panics
    /// If there are fewer than two words.
    fn gather_pairs(words: &[u32], at: &I32x16) -> (Self::I, Self::I);

    /// The words at x and y of an 8 × 8 window, those to the right of them, below them, and below to the right. The
    /// window's rows begin at `first`, `first + pitch` and so on. `None` if one of the points is outside of the first
    /// 7 × 7, or if this instruction set has no faster way than [`Self::gather_pairs`].
    ///
    /// # Panics
    /// If the window light_bounds out of `words`.
    #[inline(always)]
    fn gather_window(
        _words: &[u32],
        _first: usize,
        _pitch: usize,
        _at: [Self::I; 2],
    ) -> Option<[Self::I; 4]> {
        None
    }

    /// The number at each index in the lower half of a lane, the one right behind it in the upper half. An index outside of
    /// `halves` is a mistake, which builds with debug assertions tell; others then read some other numbers.
    ///
    /// # Panics
    /// If there are fewer than two numbers.
    #[inline(always)]
    fn gather_neighbours_u16(halves: &[u16], at: &I32x16) -> Self::I {
        let last = halves.len().checked_sub(2).expect("two numbers are neighbours") as i32;
        debug_assert!(
            at.0.iter().all(|i| (0..=last).contains(i)),
            "outside of {} numbers: {at:?}",
            halves.len()
        );
        let mut held = I32x16::ZERO;
        Self::I::load(at).max(Self::I::splat(0)).min(Self::I::splat(last)).store(&mut held);
        // SAFETY: every index is held between 0 and the last one that has a number behind it.
        let two = |i: i32| unsafe { halves.as_ptr().add(i as usize).cast::<i32>().read_unaligned() };
        Self::I::load(&I32x16(each!(i in 16 => two(held.0[i]))))
    }

    /// Of an 8 × 8 window, the numbers at x and y in the lower halves and those to the right of them in the upper halves;
    /// and those below both. The window's rows begin at `first`, `first + pitch` and so on. `None` if one of the points is outside of
    /// the first 7 × 7, or if this instruction set has no faster way than [`Self::gather_neighbours_u16`].
    ///
    /// # Panics
    /// If the window light_bounds out of `halves`.
    #[inline(always)]
    fn gather_window_u16(
        _halves: &[u16],
        _first: usize,
        _pitch: usize,
        _at: [Self::I; 2],
    ) -> Option<[Self::I; 2]> {
        None
    }

    /// Lane 4 r + 2 b + c of number k of the result is lane 4 k + 2 (r % 2) + c of number 2 (r / 2) + b of these: what lies in four
    /// squares of 2 × 2 pixels, four times over, is put in the order of one square of 4 × 4.
    fn interleave_tiles(squares: [Self::I; 4]) -> [Self::I; 4];

    /// Writes the lanes that are kept side by side, from the lowest up, and says how many they are. What is behind them in
    /// the line is lost.
    #[inline(always)]
    fn compress(numbers: Self::I, keep: Self::M, to: &mut [i32; N_LANES]) -> usize {
        let mut line = I32x16::ZERO;
        numbers.store(&mut line);
        let mut n = 0;
        for lane in SetBits(keep.to_bits()) {
            to[n] = line.0[lane];
            n += 1;
        }
        n
    }

    /// Writes the lowest three bytes of each lane, four lanes to a row.
    fn store_rgb(pixels: Self::I, rows: [&mut [u8; 12]; 4]);

    /// The same for four numbers side by side.
    #[inline(always)]
    fn store_rgb_x4(pixels: [Self::I; 4], rows: [&mut [u8; 48]; 4]) {
        let [a, b, c, d] = rows;
        let rows = [a.as_chunks_mut().0, b.as_chunks_mut().0, c.as_chunks_mut().0, d.as_chunks_mut().0];
        let [a, b, c, d] = rows;
        for (k, pixels) in pixels.into_iter().enumerate() {
            Self::store_rgb(pixels, [&mut a[k], &mut b[k], &mut c[k], &mut d[k]]);
        }
    }
}

/// A float or sixteen of them: what is the same for all pixels of a surface is computed once, by the same steps.
pub(super) trait FloatLike:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// The same number everywhere.
    fn splat(x: f32) -> Self;
    /// `self * factor + term`, rounded once.
    fn mul_add(self, factor: Self, term: Self) -> Self;
    /// Tile4x4 root.
    fn sqrt(self) -> Self;
    /// The greater; the other one if `self` is NaN.
    fn max(self, other: Self) -> Self;
    /// The lesser; the other one if `self` is NaN.
    fn min(self, other: Self) -> Self;
    /// `self` where `sign` is positive, else 0.
    fn zero_unless_positive(self, sign: Self) -> Self;
}

impl FloatLike for f32 {
    #[inline(always)]
    fn splat(x: f32) -> Self {
        x
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        Self::mul_add(self, factor, term)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self::sqrt(self)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }

    #[inline(always)]
    fn zero_unless_positive(self, sign: Self) -> Self {
        if sign > 0.0 { self } else { 0.0 }
    }
}

/// A number that can be spread over an instruction set's lanes.
pub(super) trait Broadcast<S: Simd>: FloatLike {
    /// Itself if it is sixteen, else the same everywhere.
    fn broadcast(self) -> S::F;
}

impl<S: Simd> Broadcast<S> for f32 {
    #[inline(always)]
    fn broadcast(self) -> S::F {
        S::F::splat(self)
    }
}

/// Sixteen floats.
pub(super) trait SimdF32: FloatLike {
    /// Integers as wide.
    type I;
    /// Masks as wide.
    type M;

    /// From memory.
    fn load(from: &F32x16) -> Self;
    /// From integers in memory.
    fn load_i16(from: &I16x16) -> Self;
    /// To memory.
    fn store(self, to: &mut F32x16);
    /// Where `self > other`; not for NaN.
    fn gt(self, other: Self) -> Self::M;
    /// `self` where `mask`, else `other`.
    fn select_or(self, mask: Self::M, other: Self) -> Self;
    /// To the nearest integer, ties to even; meaningless outside of ±2³¹.
    fn round_to_i32(self) -> Self::I;
    /// Towards zero; meaningless outside of ±2³¹.
    fn truncate_to_i32(self) -> Self::I;
    /// The same bits.
    fn bitcast_i32(self) -> Self::I;
}

/// Sixteen integers; arithmetic uv_records.
pub(super) trait SimdI32:
    Copy + Add<Output = Self> + Sub<Output = Self> + BitAnd<Output = Self> + BitOr<Output = Self>
{
    /// SimdF32 as wide.
    type F;
    /// Masks as wide.
    type M;

    /// The same number everywhere.
    fn splat(x: i32) -> Self;
    /// From memory.
    fn load(from: &I32x16) -> Self;
    /// Sixteen numbers anywhere in memory, or fewer and the `rest`.
    #[inline(always)]
    fn load_partial(from: &[i32], rest: i32) -> Self {
        let mut line = I32x16([rest; N_LANES]);
        let n = from.len().min(N_LANES);
        line.0[..n].copy_from_slice(&from[..n]);
        Self::load(&line)
    }
    /// To memory.
    fn store(self, to: &mut I32x16);
    /// Product, its lower 32 bits.
    fn mul(self, other: Self) -> Self;
    /// Products of both 16-bit halves, each kept to 16 bits.
    fn mul_i16(self, other: Self) -> Self;
    /// Sum of the two products of signed 16-bit halves.
    fn dot_i16(self, other: Self) -> Self;
    /// Shifted left.
    fn shl<const BITS: u32>(self) -> Self;
    /// Shifted right, zeros from the left.
    fn shr_logical<const BITS: u32>(self) -> Self;
    /// Both 16-bit halves shifted right, zeros from the left of each.
    fn shr_logical_u16<const BITS: u32>(self) -> Self;
    /// Shifted right, the sign from the left.
    fn shr_arithmetic<const BITS: u32>(self) -> Self;
    /// Shifted right by as many bits in each lane, the sign from the left.
    fn shr_arithmetic_by(self, bits: u32) -> Self;
    /// The greater.
    fn max(self, other: Self) -> Self;
    /// The lesser.
    fn min(self, other: Self) -> Self;
    /// Where `self > other`.
    fn gt(self, other: Self) -> Self::M;
    /// Where they are equal.
    fn eq(self, other: Self) -> Self::M;
    /// `self` where `mask`, else `other`.
    fn select_or(self, mask: Self::M, other: Self) -> Self;
    /// The least of the lower and the least of the upper 16-bit halves, without signs.
    #[inline(always)]
    fn reduce_min_u16(self) -> [u16; 2] {
        let mut line = I32x16::ZERO;
        self.store(&mut line);
        let mut least = [u16::MAX; 2];
        for lane in line.0 {
            let halves = [lane as u16, (lane >> 16) as u16];
            least = [least[0].min(halves[0]), least[1].min(halves[1])];
        }
        least
    }
    /// The greatest lane.
    #[inline(always)]
    fn reduce_max(self) -> i32 {
        let mut line = I32x16::ZERO;
        self.store(&mut line);
        line.0.into_iter().fold(i32::MIN, i32::max)
    }
    /// As floats, rounded to nearest.
    fn to_f32(self) -> Self::F;
    /// The same bits.
    fn bitcast_f32(self) -> Self::F;
}

/// Sixteen answers.
pub(super) trait SimdMask: Copy + BitAnd<Output = Self> + BitOr<Output = Self> {
    /// Lane i as bit i.
    fn to_bits(self) -> u16;
    /// Bit i as lane i.
    fn from_bits(bits: u16) -> Self;
    /// Whether it is yes anywhere.
    #[inline(always)]
    fn any(self) -> bool {
        self.to_bits() != 0
    }
    /// Where `self` and not `other`.
    fn and_not(self, other: Self) -> Self;
}

/// The lanes whose bits are set, from the lowest up.
pub(super) struct SetBits(pub(super) u16);

impl Iterator for SetBits {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let lane = self.0.trailing_zeros() as usize;
        self.0 &= self.0.wrapping_sub(1);
        (lane < 16).then_some(lane)
    }
}

/// Sixteen pairs of neighbouring words, the first one in the lower half.
///
/// # Panics
/// See [`Simd::pairs`].
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn load_pairs<S: Simd>(words: &[u32], at: &I32x16) -> [i64; N_LANES] {
    let last = words.len().checked_sub(2).expect("two words make a pair") as i32;
    debug_assert!(at.0.iter().all(|i| (0..=last).contains(i)), "outside of {} words: {at:?}", words.len());
    let mut held = I32x16::ZERO;
    S::I::load(at).max(S::I::splat(0)).min(S::I::splat(last)).store(&mut held);
    // SAFETY: every index is held between 0 and the last one that has a word behind it.
    each!(i in 16 => unsafe { words.as_ptr().add(held.0[i] as usize).cast::<i64>().read_unaligned() })
}
