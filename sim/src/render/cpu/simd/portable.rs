//! Plain arrays: what every processor can do.

use core::ops::{Add, BitAnd, BitOr, Div, Mul, Sub};

use super::{F32x16, Floats, I16x16, I32x16, Mask, N_LANES, Number, Per, Simd, Whole};

/// No instruction set in particular.
#[derive(Clone, Copy)]
pub(in crate::render::cpu) struct Portable;

/// Floats in an array.
#[derive(Clone, Copy)]
pub(in crate::render::cpu) struct FloatArray([f32; N_LANES]);

/// Integers in an array.
#[derive(Clone, Copy)]
pub(in crate::render::cpu) struct WholeArray([i32; N_LANES]);

/// Answers as bits.
#[derive(Clone, Copy)]
pub(in crate::render::cpu) struct Bits(u16);

fn map<A: Copy, B>(a: [A; N_LANES], f: impl Fn(A) -> B) -> [B; N_LANES] {
    a.map(f)
}

fn zip<A: Copy, B: Copy, C>(a: [A; N_LANES], b: [B; N_LANES], f: impl Fn(A, B) -> C) -> [C; N_LANES] {
    core::array::from_fn(|i| f(a[i], b[i]))
}

fn ask<A: Copy>(a: [A; N_LANES], b: [A; N_LANES], f: impl Fn(A, A) -> bool) -> Bits {
    Bits((0..N_LANES).fold(0, |bits, i| bits | u16::from(f(a[i], b[i])) << i))
}

fn choose<A: Copy>(mask: Bits, yes: [A; N_LANES], no: [A; N_LANES]) -> [A; N_LANES] {
    core::array::from_fn(|i| if mask.0 >> i & 1 == 1 { yes[i] } else { no[i] })
}

/// A float without a fraction as an integer; what does not fit becomes the least integer, as x86 has it.
fn whole(x: f32) -> i32 {
    const BEYOND: f32 = (1_u32 << 31) as f32;
    if x.abs() < BEYOND { x as i32 } else { i32::MIN }
}

/// What both halves of two numbers give.
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

operator!(FloatArray, Add, add, |a, b| a + b);
operator!(FloatArray, Sub, sub, |a, b| a - b);
operator!(FloatArray, Mul, mul, |a, b| a * b);
operator!(FloatArray, Div, div, |a, b| a / b);
operator!(WholeArray, Add, add, i32::wrapping_add);
operator!(WholeArray, Sub, sub, i32::wrapping_sub);
operator!(WholeArray, BitAnd, bitand, |a, b| a & b);
operator!(WholeArray, BitOr, bitor, |a, b| a | b);

impl Simd for Portable {
    type F = FloatArray;
    type I = WholeArray;
    type M = Bits;

    fn transposed(rows: [FloatArray; N_LANES]) -> [FloatArray; N_LANES] {
        core::array::from_fn(|column| FloatArray(core::array::from_fn(|row| rows[row].0[column])))
    }

    fn pairs(words: &[u32], at: &I32x16) -> (WholeArray, WholeArray) {
        let word = |i: i32, next: usize| words[i as usize + next].cast_signed();
        (WholeArray(map(at.0, |i| word(i, 0))), WholeArray(map(at.0, |i| word(i, 1))))
    }

    fn unfolded(squares: [WholeArray; 4]) -> [WholeArray; 4] {
        core::array::from_fn(|k| {
            WholeArray(core::array::from_fn(|lane| {
                let (row, half, column) = (lane / 4, lane / 2 % 2, lane % 2);
                squares[row / 2 * 2 + half].0[4 * k + row % 2 * 2 + column]
            }))
        })
    }

    fn store_rgb(pixels: WholeArray, rows: [&mut [u8; 12]; 4]) {
        for (row, pixels) in rows.into_iter().zip(pixels.0.chunks_exact(4)) {
            for (rgb, pixel) in row.chunks_exact_mut(3).zip(pixels) {
                rgb.copy_from_slice(&pixel.to_le_bytes()[..3]);
            }
        }
    }
}

impl Number for FloatArray {
    fn all(x: f32) -> Self {
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

    fn where_positive(self, sign: Self) -> Self {
        Self(zip(self.0, sign.0, |x, sign| if sign > 0.0 { x } else { 0.0 }))
    }
}

impl Per<Portable> for FloatArray {
    fn spread(self) -> Self {
        self
    }
}

impl Floats for FloatArray {
    type I = WholeArray;
    type M = Bits;

    fn load(from: &F32x16) -> Self {
        Self(from.0)
    }

    fn load_short(from: &I16x16) -> Self {
        Self(from.0.map(f32::from))
    }

    fn store(self, to: &mut F32x16) {
        to.0 = self.0;
    }

    fn gt(self, other: Self) -> Bits {
        ask(self.0, other.0, |a, b| a > b)
    }

    fn or_where(self, mask: Bits, other: Self) -> Self {
        Self(choose(mask, self.0, other.0))
    }

    fn rounded(self) -> WholeArray {
        WholeArray(map(self.0, |x| whole(x.round_ties_even())))
    }

    fn truncated(self) -> WholeArray {
        WholeArray(map(self.0, whole))
    }

    fn bits(self) -> WholeArray {
        WholeArray(map(self.0, |x| x.to_bits().cast_signed()))
    }
}

impl Whole for WholeArray {
    type F = FloatArray;
    type M = Bits;

    fn all(x: i32) -> Self {
        Self([x; N_LANES])
    }

    fn load(from: &I32x16) -> Self {
        Self(from.0)
    }

    fn store(self, to: &mut I32x16) {
        to.0 = self.0;
    }

    fn times(self, other: Self) -> Self {
        Self(zip(self.0, other.0, i32::wrapping_mul))
    }

    fn times_halves(self, other: Self) -> Self {
        Self(zip(self.0, other.0, |a, b| {
            let [low, high] = halves(a, b, i32::wrapping_mul);
            low & 0xFFFF | high << 16
        }))
    }

    fn dot_halves(self, other: Self) -> Self {
        Self(zip(self.0, other.0, |a, b| {
            let [low, high] = halves(a, b, i32::wrapping_mul);
            low.wrapping_add(high)
        }))
    }

    fn shl<const BITS: u32>(self) -> Self {
        Self(map(self.0, |x| x << BITS))
    }

    fn shr<const BITS: u32>(self) -> Self {
        Self(map(self.0, |x| (x.cast_unsigned() >> BITS).cast_signed()))
    }

    fn shr_halves<const BITS: u32>(self) -> Self {
        Self(map(self.0, |x| {
            let halves = x.cast_unsigned();
            (halves >> 16 >> BITS << 16 | (halves & 0xFFFF) >> BITS).cast_signed()
        }))
    }

    fn sar<const BITS: u32>(self) -> Self {
        Self(map(self.0, |x| x >> BITS))
    }

    fn sar_by(self, bits: u32) -> Self {
        Self(map(self.0, |x| x >> bits))
    }

    fn max(self, other: Self) -> Self {
        Self(zip(self.0, other.0, i32::max))
    }

    fn min(self, other: Self) -> Self {
        Self(zip(self.0, other.0, i32::min))
    }

    fn gt(self, other: Self) -> Bits {
        ask(self.0, other.0, |a, b| a > b)
    }

    fn eq(self, other: Self) -> Bits {
        ask(self.0, other.0, |a, b| a == b)
    }

    fn or_where(self, mask: Bits, other: Self) -> Self {
        Self(choose(mask, self.0, other.0))
    }

    fn floats(self) -> FloatArray {
        FloatArray(map(self.0, |x| x as f32))
    }

    fn as_float_bits(self) -> FloatArray {
        FloatArray(map(self.0, |x| f32::from_bits(x.cast_unsigned())))
    }
}

impl BitAnd for Bits {
    type Output = Self;
    fn bitand(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}

impl BitOr for Bits {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl Mask for Bits {
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
