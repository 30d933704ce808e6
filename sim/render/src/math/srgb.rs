//! The sRGB transfer function (IEC 61966-2-1): decoding of colours and the constants by which pixels are
//! encoded.

use scene::decode_srgb;

/// Linear value below which the encoding function is linear.
pub(crate) const LINEAR_SEGMENT_END: f32 = 0.003_130_8;
/// Slope of the linear segment, in 8-bit codes per unit of linear light.
pub(crate) const LINEAR_SEGMENT_SLOPE: f32 = 12.92 * 255.0;
/// Coefficients of the encoding function above the linear segment: the 8-bit code of x as a polynomial in √x,
/// highest power first. A least-squares fit at Chebyshev nodes, within 0.06 codes of the exact function.
pub(crate) const SQRT_POLYNOMIAL: [f32; 7] =
    [-188.952_12, 704.575, -1_072.413_6, 875.535_1, -450.649_72, 397.486_94, -10.601_666];

/// Decodes an sRGB value in [0, 1] to linear light in [0, 1].
pub(crate) fn decode(srgb: f64) -> f32 {
    decode_srgb(srgb) as f32
}

#[cfg(test)]
mod tests {
    use scene::decode_srgb;

    use super::{LINEAR_SEGMENT_END, LINEAR_SEGMENT_SLOPE, SQRT_POLYNOMIAL, decode};

    fn code(linear: f32) -> f32 {
        let [first, rest @ ..] = SQRT_POLYNOMIAL;
        let curve = || rest.iter().fold(first, |sum, c| sum.mul_add(linear.sqrt(), *c));
        if linear < LINEAR_SEGMENT_END { linear * LINEAR_SEGMENT_SLOPE } else { curve() }
    }

    #[test]
    fn every_code_survives_round_trip() {
        for byte in 0..=255_u8 {
            assert!((code(decode(f64::from(byte) / 255.0)) - f32::from(byte)).abs() < 0.06, "{byte}");
        }
    }

    #[test]
    fn polynomial_approximates_encoding_function() {
        for i in 0..=200_000 {
            let linear = i as f32 / 200_000.0;
            let back = decode_srgb(f64::from(code(linear)) / 255.0);
            // The linear light of 0.06 codes where the decoding function is steepest.
            assert!((back - f64::from(linear)).abs() < 0.000_6, "{linear} became {back}");
        }
    }
}
