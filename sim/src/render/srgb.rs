//! The sRGB transfer curve (IEC 61966-2-1): decoding of paints, exact encoding of pixels by table.

/// Below this linear value the curve is straight.
pub(super) const LINEAR_BELOW: f32 = 0.003_130_8;
/// Its slope there, in codes.
pub(super) const LINEAR_CODES: f32 = 12.92 * 255.0;
/// Above, the code of x as a polynomial of √x, the highest power first: a least-squares fit at Chebyshev's points that is
/// within 0.06 codes of the curve.
pub(super) const ROOT_CODES: [f32; 7] =
    [-188.952_12, 704.575, -1_072.413_6, 875.535_1, -450.649_72, 397.486_94, -10.601_666];

/// Bits of an f32's mantissa that index the table: enough that no bucket holds two thresholds.
const MANTISSA_BITS: u32 = 7;
/// Below 2⁻¹³ every code is 0; the least value of code 1 is about 1.5e-4.
const LEAST: f32 = 1.0 / 8192.0;
const SHIFT: u32 = 23 - MANTISSA_BITS;
const N_BUCKETS: usize = 13 << MANTISSA_BITS;

/// Linear value of an sRGB value, both in [0, 1].
pub(super) fn decode(srgb: f64) -> f32 {
    decode_f64(srgb) as f32
}

fn decode_f64(srgb: f64) -> f64 {
    if srgb <= 0.040_45 {
        return srgb / 12.92;
    }
    // y^2.4 = y² · ⁵√y², the root by Newton's method: unlike powf the same on every system.
    let y = (srgb + 0.055) / 1.055;
    let square = y * y;
    let mut root = 1.0;
    for _ in 0..40 {
        let fourth = root * root * root * root;
        root -= (root * fourth - square) / (5.0 * fourth);
    }
    square * root
}

/// Encoder from linear light to the nearest 8-bit sRGB code.
pub(super) struct Encoder {
    /// Per bucket of values: the code of its least value and the value from which the next code is nearer.
    buckets: Vec<(u8, f32)>,
}

impl Encoder {
    /// The table: 1664 entries.
    pub(super) fn new() -> Self {
        let threshold = |code: u8| {
            if code == 255 { f32::INFINITY } else { decode((f64::from(code) + 0.5) / 255.0) }
        };
        let mut code = 0_u8;
        let buckets = (0..N_BUCKETS).map(|bucket| {
            let least = f32::from_bits(LEAST.to_bits() + ((bucket as u32) << SHIFT));
            while least >= threshold(code) {
                code += 1;
            }
            (code, threshold(code))
        });
        Self { buckets: buckets.collect() }
    }

    /// Code of a linear value; values outside [0, 1] are clamped, NaN is black.
    #[inline(always)]
    pub(super) fn encode(&self, linear: f32) -> u8 {
        // The greatest f32 below 1 already has code 255.
        let number = if linear.is_nan() { LEAST } else { linear };
        let x = number.clamp(LEAST, 1.0 - f32::EPSILON / 2.0);
        let (code, next) = self.buckets[((x.to_bits() - LEAST.to_bits()) >> SHIFT) as usize];
        code + u8::from(x >= next)
    }
}

#[cfg(test)]
mod tests {
    use super::{Encoder, decode, decode_f64};

    #[test]
    fn every_code_survives_decoding_and_encoding() {
        let encoder = Encoder::new();
        for code in 0..=255_u8 {
            assert_eq!(encoder.encode(decode(f64::from(code) / 255.0)), code);
        }
    }

    #[test]
    fn encoding_rounds_to_the_nearest_code() {
        let encoder = Encoder::new();
        for i in 0..=200_000 {
            let linear = i as f32 / 200_000.0;
            let code = f64::from(encoder.encode(linear));
            let between = |c: f64| decode_f64(((code + c) / 255.0).clamp(0.0, 1.0)) as f32;
            assert!(linear >= between(-0.5) && linear <= between(0.5), "{linear} became {code}");
        }
    }

    #[test]
    fn what_is_not_a_brightness_is_clamped() {
        let encoder = Encoder::new();
        assert_eq!([-1.0, 7.0, f32::NAN, f32::INFINITY].map(|x| encoder.encode(x)), [0, 255, 0, 255]);
    }
}
