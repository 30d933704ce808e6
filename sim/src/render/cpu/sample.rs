//! Reading a texture for sixteen pixels: where to look is worked out for all of them at once.

use super::each::each;
use super::simd::{Floats, Line, Number, Simd, Whole, WholeLine};
use crate::render::texture::{Pattern, SIDE, level_offset, pitch};

/// Bits of a texel coordinate behind the point.
const FRACTION_BITS: u32 = 8;
/// Least fraction of a level, in 1/256, from which the next level is blended in, and how fast.
const BLEND_FROM: i32 = 96;
const BLEND_RATE: f32 = 4.0 / 256.0;

/// A point of a texture per lane, in tiles.
pub(super) type Uv<S> = [<S as Simd>::F; 2];

/// Which level to read, or which two: chosen once per block and triangle.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Level {
    /// The finer level's number.
    fine: i32,
    /// Share of the next coarser one.
    blend: f32,
}

/// Levels of sixteen footprints.
pub(super) struct Levels {
    fine: WholeLine,
    blend: Line,
}

impl Levels {
    /// None yet.
    pub(super) const NONE: Self = Self { fine: WholeLine::ZERO, blend: Line::ZERO };

    /// Of footprints: the greater squared length in tiles² that a step of one pixel right or down makes. The level is half
    /// its binary logarithm in texels², the mantissa taken as linear.
    #[inline(always)]
    pub(super) fn set<S: Simd>(&mut self, footprint: S::F) {
        const TEXELS: f32 = (SIDE * SIDE) as f32;
        let texels = (footprint * S::F::all(TEXELS)).max(S::F::all(1.0)).min(S::F::all(TEXELS * 0.999));
        // In 1/256 levels.
        let level = (texels.bits() - S::I::all(1.0_f32.to_bits().cast_signed())).shr::<16>();
        level.shr::<8>().store(&mut self.fine);
        let blend = ((level & S::I::all(255)) - S::I::all(BLEND_FROM)).floats() * S::F::all(BLEND_RATE);
        blend.max(S::F::all(0.0)).min(S::F::all(1.0)).store(&mut self.blend);
    }

    /// One of them.
    #[inline(always)]
    pub(super) fn get(&self, i: usize) -> Level {
        Level { fine: self.fine.0[i], blend: self.blend.0[i] }
    }
}

/// Where to read a texture for sixteen pixels. Finding sites and reading them are kept apart, so that a processor can
/// work on several blocks at a time: each step's chain of dependent instructions is long.
pub(super) struct Site {
    fine: Taps,
    coarse: Taps,
    /// Share of the coarse level.
    blend: f32,
}

/// Four texels around each of sixteen points.
struct Taps {
    /// Indices of the upper and lower left ones.
    left: [WholeLine; 2],
    /// Weights' horizontal and vertical parts, in 1/256.
    fraction: [WholeLine; 2],
}

impl Taps {
    const NOWHERE: Self = Self { left: [WholeLine::ZERO; 2], fraction: [WholeLine::ZERO; 2] };

    /// Around points in 1/256 texel of a level.
    #[inline(always)]
    fn locate<S: Simd>(&mut self, [x, y]: [S::I; 2], level: i32) {
        let whole = S::I::all;
        let side = SIDE as i32 >> level;
        let mask = whole(side - 1);
        // Half a texel from the corner of a texel to its middle.
        let (x, y) = (x - whole(128), y - whole(128));
        (x & whole(255)).store(&mut self.fraction[0]);
        (y & whole(255)).store(&mut self.fraction[1]);
        let (x, y) = (x.sar::<FRACTION_BITS>(), y.sar::<FRACTION_BITS>());
        let (first, pitch) = (level_offset(level as usize) as i32, whole(pitch(level as usize) as i32));
        let first = whole(first) + (x & mask);
        let (upper, lower) = (y & mask, (y + whole(1)) & mask);
        (upper.dot_halves(pitch) + first).store(&mut self.left[0]);
        (lower.dot_halves(pitch) + first).store(&mut self.left[1]);
    }

    /// Weighed sums of red, green and blue; 65280 is 1.
    #[inline(always)]
    fn read<S: Simd>(&self, pattern: &Pattern) -> [S::F; 3] {
        let whole = S::I::all;
        let (a, b) = S::pairs(&pattern.texels, &self.left[0]);
        let (c, d) = S::pairs(&pattern.texels, &self.left[1]);
        let (fx, fy) = (S::I::load(&self.fraction[0]), S::I::load(&self.fraction[1]));
        let corner = fx.times_halves(fy).shr::<8>();
        let weights = [whole(256) + corner - fx - fy, fx - corner, fy - corner, corner];
        let texels = [a, b, c, d];
        let (mut red_blue, mut green) = (whole(0), whole(0));
        for k in 0..4 {
            let (texel, weight) = (texels[k], weights[k]);
            let weight = weight | weight.shl::<16>();
            red_blue = red_blue + (texel & whole(0x00FF_00FF)).times_halves(weight);
            green = green + (texel.shr::<8>() & whole(0x00FF)).times_halves(weight);
        }
        [(red_blue & whole(0xFFFF)).floats(), green.floats(), red_blue.shr::<16>().floats()]
    }
}

impl Site {
    /// No site yet.
    pub(super) const NOWHERE: Self = Self { fine: Taps::NOWHERE, coarse: Taps::NOWHERE, blend: 0.0 };

    /// Finds where to read.
    #[inline(always)]
    pub(super) fn locate<S: Simd>(&mut self, uv: &Uv<S>, level: Level) {
        self.blend = level.blend;
        // 1/256 texel per tile: 2^(16 − level), built from its exponent.
        let exponent = (127 + SIDE.ilog2() + FRACTION_BITS).cast_signed() - level.fine;
        let scale = S::F::all(f32::from_bits((exponent << 23).cast_unsigned()));
        let [x, y] = each!(k in 2 => (uv[k] * scale).rounded());
        if level.blend < 1.0 {
            self.fine.locate::<S>([x, y], level.fine);
        }
        if level.blend > 0.0 {
            self.coarse.locate::<S>([x.sar::<1>(), y.sar::<1>()], level.fine + 1);
        }
    }

    /// Linear factors of red, green and blue, in [0, 1].
    #[inline(always)]
    pub(super) fn read<S: Simd>(&self, pattern: &Pattern) -> [S::F; 3] {
        let taps = if self.blend < 1.0 { &self.fine } else { &self.coarse };
        let mut root = taps.read::<S>(pattern);
        if self.blend > 0.0 && self.blend < 1.0 {
            let (coarse, blend) = (self.coarse.read::<S>(pattern), S::F::all(self.blend));
            root = each!(c in 3 => (coarse[c] - root[c]).mul_add(blend, root[c]));
        }
        each!(c in 3 => {
            let t = root[c] * S::F::all(1.0 / 65280.0);
            t * t
        })
    }
}
