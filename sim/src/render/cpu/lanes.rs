//! Sixteen numbers side by side, one per pixel of a group: arithmetic on them is what the compiler turns into vector
//! instructions. Every operation is the IEEE one in each lane, so results do not depend on the instruction set.

use core::ops::{Add, Div, Mul, Neg, Sub};

/// Pixels of a group.
pub(super) const N_LANES: usize = 16;

/// One number per pixel.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Lanes(pub(super) [f32; N_LANES]);

/// A vector per pixel, or a colour.
pub(super) type Lanes3 = [Lanes; 3];

impl Lanes {
    /// Zero everywhere.
    pub(super) const ZERO: Self = Self([0.0; N_LANES]);

    /// The same number everywhere.
    #[inline(always)]
    pub(super) fn all(x: f32) -> Self {
        Self([x; N_LANES])
    }

    /// `first`, `first + 1`, and so on.
    #[inline(always)]
    pub(super) fn counting(first: f32) -> Self {
        let mut lanes = Self::ZERO;
        for (i, lane) in lanes.0.iter_mut().enumerate() {
            *lane = first + i as f32;
        }
        lanes
    }

    #[inline(always)]
    fn each(self, f: impl Fn(f32) -> f32) -> Self {
        let mut lanes = Self::ZERO;
        for i in 0..N_LANES {
            lanes.0[i] = f(self.0[i]);
        }
        lanes
    }

    #[inline(always)]
    fn with(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut lanes = Self::ZERO;
        for i in 0..N_LANES {
            lanes.0[i] = f(self.0[i], other.0[i]);
        }
        lanes
    }

    /// Square root.
    #[inline(always)]
    pub(super) fn sqrt(self) -> Self {
        self.each(f32::sqrt)
    }

    /// The greater of each and `least`; `least` for NaN.
    #[inline(always)]
    pub(super) fn at_least(self, least: f32) -> Self {
        self.each(|x| if x > least { x } else { least })
    }

    /// The lesser of each and `greatest`; `greatest` for NaN.
    #[inline(always)]
    pub(super) fn at_most(self, greatest: f32) -> Self {
        self.each(|x| if x < greatest { x } else { greatest })
    }

    /// The greater of the two, lane by lane.
    #[inline(always)]
    pub(super) fn max(self, other: Self) -> Self {
        self.with(other, |a, b| if a > b { a } else { b })
    }

    /// The number where `sign` is positive, 0 elsewhere.
    #[inline(always)]
    pub(super) fn where_positive(self, sign: Self) -> Self {
        self.with(sign, |x, s| if s > 0.0 { x } else { 0.0 })
    }
}

impl Add for Lanes {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(other, |a, b| a + b)
    }
}

impl Sub for Lanes {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(other, |a, b| a - b)
    }
}

impl Mul for Lanes {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.with(other, |a, b| a * b)
    }
}

impl Mul<f32> for Lanes {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: f32) -> Self {
        self.each(|x| x * factor)
    }
}

impl Add<f32> for Lanes {
    type Output = Self;
    #[inline(always)]
    fn add(self, term: f32) -> Self {
        self.each(|x| x + term)
    }
}

impl Div for Lanes {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.with(other, |a, b| a / b)
    }
}

impl Neg for Lanes {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.each(|x| -x)
    }
}

/// Dot product, summed in order.
#[inline(always)]
pub(super) fn dot(a: &Lanes3, b: &Lanes3) -> Lanes {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Dot product with one vector for all pixels.
#[inline(always)]
pub(super) fn dot_all(a: &Lanes3, b: [f32; 3]) -> Lanes {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
