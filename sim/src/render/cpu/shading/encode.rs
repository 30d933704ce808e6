//! From light to 8-bit sRGB.

use crate::render::cpu::simd::{FloatLike, Simd, SimdF32};
use crate::render::math::srgb::{LINEAR_SEGMENT_END, LINEAR_SEGMENT_SLOPE, SQRT_POLYNOMIAL};

/// Codes 0 to 255 of the square roots of linear light, none of which is negative; what is greater than 1 is white.
#[inline(always)]
pub(in crate::render::cpu) fn encode<S: Simd>(root: S::F) -> S::I {
    let root = root.min(S::F::splat(1.0));
    // Pairs of powers first: fewer steps wait for one another than in Horner's scheme.
    let [six, five, four, three, two, one, zero] = SQRT_POLYNOMIAL;
    let square = root * root;
    let high = root.mul_add(S::F::splat(five), S::F::splat(four));
    let middle = root.mul_add(S::F::splat(three), S::F::splat(two));
    let low = root.mul_add(S::F::splat(one), S::F::splat(zero));
    let curve = square.mul_add(S::F::splat(six), high);
    let curve = square.mul_add(square.mul_add(curve, middle), low);
    let straight = square * S::F::splat(LINEAR_SEGMENT_SLOPE);
    let code = straight.select_or(S::F::splat(LINEAR_SEGMENT_END).gt(square), curve);
    (code + S::F::splat(0.5)).truncate_to_i32()
}
