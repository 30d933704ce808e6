//! Conversion of linear light to 8-bit sRGB.

use crate::cpu::simd::{FloatLike, Simd, SimdF32};
use crate::math::srgb::{LINEAR_SEGMENT_END, LINEAR_SEGMENT_SLOPE, SQRT_POLYNOMIAL};

/// Returns the sRGB codes, 0 to 255, of linear light given by its square roots. Roots must not be negative;
/// those above 1 saturate. The curve is a polynomial in the root, see [`crate::math::srgb`].
#[inline(always)]
pub(crate) fn encode<S: Simd>(root: S::F) -> S::I {
    let root = root.min(S::F::splat(1.0));
    // Estrin's scheme: its dependency chain is shorter than that of Horner's.
    let [six, five, four, three, two, one, zero] = SQRT_POLYNOMIAL;
    let square = root * root;
    let high = root.mul_add(S::F::splat(five), S::F::splat(four));
    let middle = root.mul_add(S::F::splat(three), S::F::splat(two));
    let low = root.mul_add(S::F::splat(one), S::F::splat(zero));
    let curve = square.mul_add(S::F::splat(six), high);
    let curve = square.mul_add(square.mul_add(curve, middle), low);
    let linear = square * S::F::splat(LINEAR_SEGMENT_SLOPE);
    let code = linear.select_or(S::F::splat(LINEAR_SEGMENT_END).gt(square), curve);
    (code + S::F::splat(0.5)).truncate_to_i32()
}
