//! Reading textures for a group of pixels: where to look is worked out for all of them at once.

use super::lanes::{Lanes, Lanes3, N_LANES};
use crate::render::texture::{PITCH_BITS, Pattern, SIDE};

/// An integer per pixel.
type Whole = [u32; N_LANES];

/// Factors of red, green and blue, in [0, 1], at (`u`, `v`) in tiles, filtered over a pixel whose longer side spans
/// √`footprint` tiles: bilinear within the two nearest levels, linear between them.
#[inline(always)]
pub(super) fn sample(pattern: &Pattern, uv: &[Lanes; 2], footprint: &Lanes) -> Lanes3 {
    let (mut x, mut y, mut side, mut blend) = ([0; N_LANES], [0; N_LANES], [0; N_LANES], [0; N_LANES]);
    for i in 0..N_LANES {
        let level = level_of(footprint.0[i]);
        blend[i] = level & 255;
        side[i] = SIDE as u32 >> (level >> 8);
        // In 1/256 texel of the finer level. An i32 holds 16,384 tiles.
        let scale = (side[i] * 256) as f32;
        x[i] = ((uv[0].0[i] * scale) as i32).cast_unsigned();
        y[i] = ((uv[1].0[i] * scale) as i32).cast_unsigned();
    }
    let fine = Taps::new(&x, &y, &side);
    for i in 0..N_LANES {
        x[i] = (x[i].cast_signed() >> 1).cast_unsigned();
        y[i] = (y[i].cast_signed() >> 1).cast_unsigned();
        side[i] /= 2;
    }
    let coarse = Taps::new(&x, &y, &side);
    let mut mixed = [0; N_LANES];
    for (i, texel) in mixed.iter_mut().enumerate() {
        let blend = u64::from(blend[i]);
        *texel = fine.weigh(i, pattern) * (256 - blend) + coarse.weigh(i, pattern) * blend;
    }
    let mut factors = [Lanes::ZERO; 3];
    for (c, factor) in factors.iter_mut().enumerate() {
        for (value, texel) in factor.0.iter_mut().zip(&mixed) {
            *value = ((texel >> (16 * c)) & 0xFFFF) as u32 as f32 * (1.0 / 65280.0);
        }
    }
    factors
}

/// Mip level in 1/256 levels: half the binary logarithm of the footprint in texels², its mantissa taken as linear.
#[inline(always)]
fn level_of(footprint: f32) -> u32 {
    const LARGEST: f32 = (SIDE * SIDE) as f32 * 0.999;
    let texels = footprint * (SIDE * SIDE) as f32;
    let texels = if texels > 1.0 { texels } else { 1.0 };
    let texels = if texels < LARGEST { texels } else { LARGEST };
    ((texels.to_bits() - 1.0_f32.to_bits()) >> 15) / 2
}

/// The four texels around each pixel's point and their weights, which sum to 256.
struct Taps {
    indices: [Whole; 4],
    weights: [Whole; 4],
}

impl Taps {
    /// Around points in 1/256 texel of levels with `side` texels.
    #[inline(always)]
    fn new(x: &Whole, y: &Whole, side: &Whole) -> Self {
        let mut taps = Self { indices: [[0; N_LANES]; 4], weights: [[0; N_LANES]; 4] };
        for i in 0..N_LANES {
            let (mask, first_row) = (side[i].wrapping_sub(1), Pattern::first_row(side[i]));
            // Half a texel from the corner of a texel to its middle.
            let (x, y) = (x[i].wrapping_sub(128), y[i].wrapping_sub(128));
            let (left, right) = ((x >> 8) & mask, (x >> 8).wrapping_add(1) & mask);
            let upper = (first_row + ((y >> 8) & mask)) << PITCH_BITS;
            let lower = (first_row + ((y >> 8).wrapping_add(1) & mask)) << PITCH_BITS;
            let (fx, fy) = (x & 255, y & 255);
            let corner = (fx * fy) >> 8;
            taps.indices[0][i] = upper | left;
            taps.indices[1][i] = upper | right;
            taps.indices[2][i] = lower | left;
            taps.indices[3][i] = lower | right;
            taps.weights[0][i] = 256 + corner - fx - fy;
            taps.weights[1][i] = fx - corner;
            taps.weights[2][i] = fy - corner;
            taps.weights[3][i] = corner;
        }
        taps
    }

    /// The weighed texel of pixel `i`.
    #[inline(always)]
    fn weigh(&self, i: usize, pattern: &Pattern) -> u64 {
        let tap = |k: usize| pattern.texel(self.indices[k][i]) * u64::from(self.weights[k][i]);
        ((tap(0) + tap(1) + tap(2) + tap(3)) >> 8) & 0x00FF_00FF_00FF
    }
}

#[cfg(test)]
mod tests {
    use super::{level_of, sample};
    use crate::render::cpu::lanes::Lanes;
    use crate::render::texture::{Pattern, SIDE};
    use crate::scene::Texture;

    fn at(pattern: &Pattern, u: f32, v: f32, footprint: f32) -> [f32; 3] {
        let [r, g, b] = sample(pattern, &[Lanes::all(u), Lanes::all(v)], &Lanes::all(footprint));
        [r.0[3], g.0[3], b.0[3]]
    }

    #[test]
    fn patterns_repeat_and_coarsen_to_their_mean() {
        for texture in [Texture::Wood, Texture::Checker, Texture::BrushedMetal, Texture::Plaster] {
            let pattern = Pattern::new(texture);
            assert_eq!(at(&pattern, 0.25, 0.75, 1e-9), at(&pattern, 2.25, -1.25, 1e-9));
            let mean = at(&pattern, 0.1, 0.2, 1.0);
            assert!(mean.iter().all(|c| (0.4..0.95).contains(c)), "{texture:?}: {mean:?}");
            let n = SIDE;
            let fine = (0..n * n)
                .map(|i| at(&pattern, (i % n) as f32 / n as f32, (i / n) as f32 / n as f32, 1e-9)[1]);
            let fine = fine.sum::<f32>() / (n * n) as f32;
            assert!((fine - mean[1]).abs() < 0.02, "{texture:?}: {fine} and {}", mean[1]);
        }
    }

    #[test]
    fn a_pixel_that_spans_more_texels_takes_a_coarser_level() {
        let texel = 1.0 / SIDE as f32;
        assert_eq!(level_of(texel * texel), 0);
        assert_eq!(level_of(16.0 * texel * texel), 2 << 8);
        assert_eq!(level_of(f32::NAN), 0);
        assert_eq!(level_of(1e9) >> 8, SIDE.ilog2() - 1);
    }
}
