//! Portable implementation on plain arrays.

use core::ops::{Add, BitAnd, BitOr, Div, Mul, Sub};

use super::{Broadcast, F32x16, FloatLike, I16x16, I32x16, N_LANES, Simd, SimdF32, SimdI32, SimdMask};

/// The portable implementation, for any processor.
#[derive(Clone, Copy)]
pub(crate) struct Portable;

/// Sixteen floats in an array.
#[derive(Clone, Copy)]
pub(crate) struct PortableF32([f32; N_LANES]);

/// Sixteen integers in an array.
#[derive(Clone, Copy)]
pub(crate) struct PortableI32([i32; N_LANES]);

/// Sixteen booleans as the bits of an integer.
#[derive(Clone, Copy)]
pub(crate) struct PortableMask(u16);

fn map<A: Copy, B>(a: [A; N_LANES], f: impl Fn(A) -> B) -> [B; N_LANES] {
    a.map(f)
}

fn zip<A: Copy, B: Copy, C>(a: [A; N_LANES], b: [B; N_LANES], f: impl Fn(A, B) -> C) -> [C; N_LANES] {
    core::array::from_fn(|i| f(a[i], b[i]))
}

fn compare<A: Copy>(a: [A; N_LANES], b: [A; N_LANES], f: impl Fn(A, A) -> bool) -> PortableMask {
    PortableMask((0..N_LANES).fold(0, |bits, i| bits | u16::from(f(a[i], b[i])) << i))
}

fn select<A: Copy>(mask: PortableMask, set: [A; N_LANES], unset: [A; N_LANES]) -> [A; N_LANES] {
    core::array::from_fn(|i| if mask.0 >> i & 1 == 1 { set[i] } else { unset[i] })
}

/// Converts an integral float to an integer. Out-of-range values become `i32::MIN`, as on x86.
fn to_i32(x: f32) -> i32 {
    const LIMIT: f32 = (1_u32 << 31) as f32;
    if x.abs() < LIMIT { x as i32 } else { i32::MIN }
}

/// Applies `f` to the signed low halves and to the signed high halves of `a` and `b`.
fn halves(a: i32, b: i32, f: impl Fn(i32, i32) -> i32) -> [i32; 2] {
    let low = |x: i32| i32::from(x as i16);
    [f(low(a), low(b)), f(a >> 16, b >> 16)]
}

macro_rules! operator {
    ($type:ident, $trait:ident, $method:ident, $f:expr) => {
        impl $trait for $type {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                Self(zip(self.0, other.0, $f))
            }
        }
    };
}

operator!(PortableF32, Add, add, |a, b| a + b);
operator!(PortableF32, Sub, sub, |a, b| a - b);
operator!(PortableF32, Mul, mul, |a, b| a * b);
operator!(PortableF32, Div, div, |a, b| a / b);
operator!(PortableI32, Add, add, i32::wrapping_add);
operator!(PortableI32, Sub, sub, i32::wrapping_sub);
operator!(PortableI32, BitAnd, bitand, |a, b| a & b);
operator!(PortableI32, BitOr, bitor, |a, b| a | b);

impl Simd for Portable {
    type F = PortableF32;
    type I = PortableI32;
    type M = PortableMask;

    fn transpose(rows: [PortableF32; N_LANES]) -> [PortableF32; N_LANES] {
        core::array::from_fn(|column| PortableF32(core::array::from_fn(|row| rows[row].0[column])))
    }

    fn gather_pairs(words: &[u32], at: &I32x16) -> (PortableI32, PortableI32) {
        let word = |i: i32, next: usize| words[i as usize + next].cast_signed();
        (PortableI32(map(at.0, |i| word(i, 0))), PortableI32(map(at.0, |i| word(i, 1))))
    }

    fn interleave_tiles(tiles: [PortableI32; 4]) -> [PortableI32; 4] {
        core::array::from_fn(|k| {
            PortableI32(core::array::from_fn(|lane| {
                let (row, half, column) = (lane / 4, lane / 2 % 2, lane % 2);
                tiles[row / 2 * 2 + half].0[4 * k + row % 2 * 2 + column]
            }))
        })
    }

    fn store_rgb(pixels: PortableI32, rows: [&mut [u8; 12]; 4]) {
        for (row, pixels) in rows.into_iter().zip(pixels.0.chunks_exact(4)) {
            for (rgb, pixel) in row.chunks_exact_mut(3).zip(pixels) {
                rgb.copy_from_slice(&pixel.to_le_bytes()[..3]);
            }
        }
    }
}

impl FloatLike for PortableF32 {
    fn splat(x: f32) -> Self {
        Self([x; N_LANES])
    }

    fn mul_add(self, factor: Self, term: Self) -> Self {
        Self(core::array::from_fn(|i| self.0[i].mul_add(factor.0[i], term.0[i])))
    }

    fn sqrt(self) -> Self {
        Self(map(self.0, f32::sqrt))
    }

    fn max(self, other: Self) -> Self {
        Self(zip(self.0, other.0, |a, b| if a > b { a } else { b }))
    }

    fn min(self, other: Self) -> Self {
        Self(zip(self.0, other.0, |a, b| if a < b { a } else { b }))
    }
}

impl Broadcast<Portable> for PortableF32 {
    fn broadcast(self) -> Self {
        self
    }
}

impl SimdF32 for PortableF32 {
    type I = PortableI32;
    type M = PortableMask;

    fn load(from: &F32x16) -> Self {
        Self(from.0)
    }

    fn load_i16(from: &I16x16) -> Self {
        Self(from.0.map(f32::from))
    }

    fn store(self, to: &mut F32x16) {
        to.0 = self.0;
    }

    fn gt(self, other: Self) -> PortableMask {
        compare(self.0, other.0, |a, b| a > b)
    }

    fn select_or(self, mask: PortableMask, other: Self) -> Self {
        Self(select(mask, self.0, other.0))
    }

    fn round_to_i32(self) -> PortableI32 {
        PortableI32(map(self.0, |x| to_i32(x.round_ties_even())))
    }

    fn truncate_to_i32(self) -> PortableI32 {
        PortableI32(map(self.0, to_i32))
    }

    fn bitcast_i32(self) -> PortableI32 {
        PortableI32(map(self.0, |x| x.to_bits().cast_signed()))
    }
}

impl SimdI32 for PortableI32 {
    type F = PortableF32;
    type M = PortableMask;

    fn splat(x: i32) -> Self {
        Self([x; N_LANES])
    }

    fn load(from: &I32x16) -> Self {
        Self(from.0)
    }

    fn store(self, to: &mut I32x16) {
        to.0 = self.0;
    }

    fn mul(self, other: Self) -> Self {
        Self(zip(self.0, other.0, i32::wrapping_mul))
    }

    fn mul_i16(self, other: Self) -> Self {
        Self(zip(self.0, other.0, |a, b| {
            let [low, high] = halves(a, b, i32::wrapping_mul);
            low & 0xFFFF | high << 16
        }))
    }

    fn dot_i16(self, other: Self) -> Self {
        Self(zip(self.0, other.0, |a, b| {
            let [low, high] = halves(a, b, i32::wrapping_mul);
            low.wrapping_add(high)
        }))
    }

    fn shl<const BITS: u32>(self) -> Self {
        Self(map(self.0, |x| x << BITS))
    }

    fn shr_logical<const BITS: u32>(self) -> Self {
        Self(map(self.0, |x| (x.cast_unsigned() >> BITS).cast_signed()))
    }

    fn shr_logical_u16<const BITS: u32>(self) -> Self {
        Self(map(self.0, |x| {
            let halves = x.cast_unsigned();
            (halves >> 16 >> BITS << 16 | (halves & 0xFFFF) >> BITS).cast_signed()
        }))
    }

    fn shr_arithmetic<const BITS: u32>(self) -> Self {
        Self(map(self.0, |x| x >> BITS))
    }

    fn shr_arithmetic_by(self, bits: u32) -> Self {
        Self(map(self.0, |x| x >> bits))
    }

    fn max(self, other: Self) -> Self {
        Self(zip(self.0, other.0, i32::max))
    }

    fn min(self, other: Self) -> Self {
        Self(zip(self.0, other.0, i32::min))
    }

    fn gt(self, other: Self) -> PortableMask {
        compare(self.0, other.0, |a, b| a > b)
    }

    fn eq(self, other: Self) -> PortableMask {
        compare(self.0, other.0, |a, b| a == b)
    }

    fn select_or(self, mask: PortableMask, other: Self) -> Self {
        Self(select(mask, self.0, other.0))
    }

    fn to_f32(self) -> PortableF32 {
        PortableF32(map(self.0, |x| x as f32))
    }

    fn bitcast_f32(self) -> PortableF32 {
        PortableF32(map(self.0, |x| f32::from_bits(x.cast_unsigned())))
    }
}

impl BitAnd for PortableMask {
    type Output = Self;
    fn bitand(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}

impl BitOr for PortableMask {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl SimdMask for PortableMask {
    fn to_bits(self) -> u16 {
        self.0
    }

    fn from_bits(bits: u16) -> Self {
        Self(bits)
    }

    fn and_not(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }
}
