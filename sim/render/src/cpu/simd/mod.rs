//! Vectors of sixteen lanes and their operations, implemented once per instruction set.
//!
//! Every operation is the IEEE 754 or integer operation in each lane, fused multiply-add included, so generic
//! code produces identical bits on every instruction set. Values of an implementation exist only in code
//! compiled for its instruction set ([`isa`]), which makes its intrinsics sound.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
pub(crate) mod each;
pub(crate) mod isa;
#[cfg(target_arch = "x86_64")]
mod permute512;
mod portable;
#[cfg(target_arch = "x86_64")]
mod registers;

use core::ops::{Add, BitAnd, BitOr, Div, Mul, Sub};

#[cfg(target_arch = "x86_64")]
pub(crate) use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) use avx512::Avx512;
pub(crate) use portable::Portable;

pub(crate) use crate::math::lanes::{F32x16, I16x16, I32x16, N_LANES};
use each::each;

/// Vector types of an instruction set and the operations that combine several of them.
pub(crate) trait Simd: Copy {
    /// `[16] f32`.
    type F: SimdF32<I = Self::I, M = Self::M> + Broadcast<Self>;
    /// `[16] i32`.
    type I: SimdI32<F = Self::F, M = Self::M>;
    /// `[16] bool`.
    type M: SimdMask;

    /// Transposes a 16 × 16 matrix given as rows.
    fn transpose(rows: [Self::F; N_LANES]) -> [Self::F; N_LANES];

    /// Gathers the words at each index of `at` and their right neighbours. An out-of-range index is a bug: it
    /// panics with debug assertions and otherwise yields some other word of the slice.
    ///
    /// # Panics
    /// If there are fewer than two words.
    fn gather_pairs(words: &[u32], at: &I32x16) -> (Self::I, Self::I);

    /// Gathers from an 8 × 8 window the words at (x, y), (x + 1, y), (x, y + 1) and (x + 1, y + 1). The rows
    /// of the window start at `first`, `first + pitch` and so on. Returns `None` if a point lies outside the
    /// first 7 × 7, or if this instruction set has no faster implementation than [`Self::gather_pairs`].
    ///
    /// # Panics
    /// If the window exceeds `words`.
    #[inline(always)]
    fn gather_window(
        _words: &[u32],
        _first: usize,
        _pitch: usize,
        _at: [Self::I; 2],
    ) -> Option<[Self::I; 4]> {
        None
    }

    /// Gathers the number at each index of `at` into the low half of its lane and its right neighbour into
    /// the high half. An out-of-range index is a bug: it panics with debug assertions and otherwise yields
    /// some other number of the slice.
    ///
    /// # Panics
    /// If there are fewer than two numbers.
    #[inline(always)]
    fn gather_neighbours_u16(halves: &[u16], at: &I32x16) -> Self::I {
        let last = halves.len().checked_sub(2).expect("at least two numbers") as i32;
        debug_assert!(
            at.0.iter().all(|i| (0..=last).contains(i)),
            "out of range of {} numbers: {at:?}",
            halves.len()
        );
        let mut clamped = I32x16::ZERO;
        Self::I::load(at).max(Self::I::splat(0)).min(Self::I::splat(last)).store(&mut clamped);
        // SAFETY: every index is clamped to 0..=last, and `last` has a right neighbour.
        let pair = |i: i32| unsafe { halves.as_ptr().add(i as usize).cast::<i32>().read_unaligned() };
        Self::I::load(&I32x16(each!(i in 16 => pair(clamped.0[i]))))
    }

    /// Gathers from an 8 × 8 window the numbers at (x, y) in the low halves and at (x + 1, y) in the high
    /// halves, and the same for the row below. The rows of the window start at `first`, `first + pitch` and
    /// so on. Returns `None` if a point lies outside the first 7 × 7, or if this instruction set has no
    /// faster implementation than [`Self::gather_neighbours_u16`].
    ///
    /// # Panics
    /// If the window exceeds `halves`.
    #[inline(always)]
    fn gather_window_u16(
        _halves: &[u16],
        _first: usize,
        _pitch: usize,
        _at: [Self::I; 2],
    ) -> Option<[Self::I; 2]> {
        None
    }

    /// Reorders the samples of 4 × 4 pixels from four multisample tiles of 2 × 2 pixels each, given in
    /// row-major order. Vector k of the result holds sample k of every pixel in the lane order of a 4 × 4
    /// tile: its lane 4 r + 2 b + c is lane 4 k + 2 (r % 2) + c of tile 2 (r / 2) + b.
    fn interleave_tiles(squares: [Self::I; 4]) -> [Self::I; 4];

    /// Writes the lanes selected by `keep` contiguously, the lowest first, and returns their number. The
    /// contents of `to` after them are unspecified.
    #[inline(always)]
    fn compress(numbers: Self::I, keep: Self::M, to: &mut [i32; N_LANES]) -> usize {
        let mut lanes = I32x16::ZERO;
        numbers.store(&mut lanes);
        let mut n = 0;
        for lane in SetBits(keep.to_bits()) {
            to[n] = lanes.0[lane];
            n += 1;
        }
        n
    }

    /// Writes the low three bytes of each lane, four lanes per row.
    fn store_rgb(pixels: Self::I, rows: [&mut [u8; 12]; 4]);

    /// Like [`Self::store_rgb`] for four horizontally adjacent tiles.
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

/// Operations common to `f32` and vectors of it. A quantity that is the same for all pixels of a surface is
/// computed once, as a scalar, by the same steps.
pub(crate) trait FloatLike:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// Broadcasts `x` to all lanes.
    fn splat(x: f32) -> Self;
    /// Returns `self * factor + term` with a single rounding.
    fn mul_add(self, factor: Self, term: Self) -> Self;
    /// Returns the square root.
    fn sqrt(self) -> Self;
    /// Returns the maximum, or `other` if `self` is NaN.
    fn max(self, other: Self) -> Self;
    /// Returns the minimum, or `other` if `self` is NaN.
    fn min(self, other: Self) -> Self;
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
}

/// A scalar or vector that can be converted to a vector of an instruction set.
pub(crate) trait Broadcast<S: Simd>: FloatLike {
    /// Returns a vector unchanged and a scalar in all lanes.
    fn broadcast(self) -> S::F;
}

impl<S: Simd> Broadcast<S> for f32 {
    #[inline(always)]
    fn broadcast(self) -> S::F {
        S::F::splat(self)
    }
}

/// Sixteen f32 lanes.
pub(crate) trait SimdF32: FloatLike {
    /// Matching integer vector.
    type I;
    /// Matching mask.
    type M;

    /// Loads from memory.
    fn load(from: &F32x16) -> Self;
    /// Loads 16-bit integers and converts them.
    fn load_i16(from: &I16x16) -> Self;
    /// Stores to memory.
    fn store(self, to: &mut F32x16);
    /// Compares `self > other`; false for NaN.
    fn gt(self, other: Self) -> Self::M;
    /// Returns `self` where `mask` is set and `other` elsewhere.
    fn select_or(self, mask: Self::M, other: Self) -> Self;
    /// Rounds to the nearest integer, ties to even. Unspecified outside ±2³¹.
    fn round_to_i32(self) -> Self::I;
    /// Truncates towards zero. Unspecified outside ±2³¹.
    fn truncate_to_i32(self) -> Self::I;
    /// Reinterprets the bits as integers.
    fn bitcast_i32(self) -> Self::I;
}

/// Sixteen integers; arithmetic uv_records.
pub(crate) trait SimdI32:
    Copy + Add<Output = Self> + Sub<Output = Self> + BitAnd<Output = Self> + BitOr<Output = Self>
{
    /// SimdF32 as wide.
    type F;
    /// Matching mask.
    type M;

    /// Broadcasts `x` to all lanes.
    fn splat(x: i32) -> Self;
    /// Loads from memory.
    fn load(from: &I32x16) -> Self;
    /// Loads up to sixteen numbers of an unaligned slice and fills the remaining lanes with `rest`.
    #[inline(always)]
    fn load_partial(from: &[i32], rest: i32) -> Self {
        let mut lanes = I32x16([rest; N_LANES]);
        let n = from.len().min(N_LANES);
        lanes.0[..n].copy_from_slice(&from[..n]);
        Self::load(&lanes)
    }
    /// Stores to memory.
    fn store(self, to: &mut I32x16);
    /// Returns the low 32 bits of the product.
    fn mul(self, other: Self) -> Self;
    /// Multiplies the 16-bit halves separately and keeps the low 16 bits of each product.
    fn mul_i16(self, other: Self) -> Self;
    /// Multiplies the signed 16-bit halves and returns the sum of both products.
    fn dot_i16(self, other: Self) -> Self;
    /// Shifts left.
    fn shl<const BITS: u32>(self) -> Self;
    /// Shifts right, inserting zeros.
    fn shr_logical<const BITS: u32>(self) -> Self;
    /// Shifts both 16-bit halves right, inserting zeros.
    fn shr_logical_u16<const BITS: u32>(self) -> Self;
    /// Shifts right, inserting the sign bit.
    fn shr_arithmetic<const BITS: u32>(self) -> Self;
    /// Shifts every lane right by `bits`, inserting the sign bit.
    fn shr_arithmetic_by(self, bits: u32) -> Self;
    /// Returns the maximum.
    fn max(self, other: Self) -> Self;
    /// Returns the minimum.
    fn min(self, other: Self) -> Self;
    /// Compares `self > other`.
    fn gt(self, other: Self) -> Self::M;
    /// Compares for equality.
    fn eq(self, other: Self) -> Self::M;
    /// Returns `self` where `mask` is set and `other` elsewhere.
    fn select_or(self, mask: Self::M, other: Self) -> Self;
    /// Returns the minima of the low and of the high 16-bit halves of all lanes, as unsigned numbers.
    #[inline(always)]
    fn reduce_min_u16(self) -> [u16; 2] {
        let mut lanes = I32x16::ZERO;
        self.store(&mut lanes);
        let mut min = [u16::MAX; 2];
        for lane in lanes.0 {
            let halves = [lane as u16, (lane >> 16) as u16];
            min = [min[0].min(halves[0]), min[1].min(halves[1])];
        }
        min
    }
    /// Returns the maximum over all lanes.
    #[inline(always)]
    fn reduce_max(self) -> i32 {
        let mut lanes = I32x16::ZERO;
        self.store(&mut lanes);
        lanes.0.into_iter().fold(i32::MIN, i32::max)
    }
    /// Converts to floats, rounding to nearest.
    fn to_f32(self) -> Self::F;
    /// Reinterprets the bits as floats.
    fn bitcast_f32(self) -> Self::F;
}

/// Sixteen boolean lanes.
pub(crate) trait SimdMask: Copy + BitAnd<Output = Self> + BitOr<Output = Self> {
    /// Packs lane i into bit i.
    fn to_bits(self) -> u16;
    /// Unpacks bit i into lane i.
    fn from_bits(bits: u16) -> Self;
    /// Returns `true` if any lane is set.
    #[inline(always)]
    fn any(self) -> bool {
        self.to_bits() != 0
    }
    /// Returns `self & !other`.
    fn and_not(self, other: Self) -> Self;
}

/// Iterator over the indices of the set bits, the lowest first.
pub(crate) struct SetBits(pub(crate) u16);

impl Iterator for SetBits {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let lane = self.0.trailing_zeros() as usize;
        self.0 &= self.0.wrapping_sub(1);
        (lane < 16).then_some(lane)
    }
}

/// Loads sixteen pairs of adjacent words, the first of each pair in the low half.
///
/// # Panics
/// See [`Simd::gather_pairs`].
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn load_pairs<S: Simd>(words: &[u32], at: &I32x16) -> [i64; N_LANES] {
    let last = words.len().checked_sub(2).expect("at least two words") as i32;
    debug_assert!(
        at.0.iter().all(|i| (0..=last).contains(i)),
        "out of range of {} words: {at:?}",
        words.len()
    );
    let mut clamped = I32x16::ZERO;
    S::I::load(at).max(S::I::splat(0)).min(S::I::splat(last)).store(&mut clamped);
    // SAFETY: every index is clamped to 0..=last, and `last` has a right neighbour.
    each!(i in 16 => unsafe { words.as_ptr().add(clamped.0[i] as usize).cast::<i64>().read_unaligned() })
}
