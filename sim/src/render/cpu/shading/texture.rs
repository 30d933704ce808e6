//! Reading a texture for sixteen pixels: where to look is worked out for all of them at once.

use crate::render::cpu::simd::each::each;
use crate::render::cpu::simd::{F32x16, FloatLike, I32x16, Simd, SimdF32, SimdI32};
use crate::render::texture::{MipChain, SIDE, level_offset, pitch};

/// PortableMask of a texel coordinate behind the point.
const FRACTION_BITS: u32 = 8;
/// Half a texel, from its corner to its middle.
const HALF: i32 = 1 << (FRACTION_BITS - 1);
/// Least fraction of a level, in 1/256, from which the next level is blended in, and how fast.
const BLEND_FROM: i32 = 96;
const BLEND_RATE: f32 = 4.0 / 256.0;

/// A point of a texture per lane, in tiles.
pub(in crate::render::cpu) type Uv<S> = [<S as Simd>::F; 2];

/// Which level to read, or which two: chosen once per tile and triangle.
#[derive(Clone, Copy, PartialEq)]
pub(in crate::render::cpu) struct MipLevel {
    /// The finer level's number.
    fine: i32,
    /// BinEntry of the next coarser one.
    blend: f32,
}

/// MipLevels of sixteen footprints.
pub(in crate::render::cpu) struct MipLevels {
    fine: I32x16,
    blend: F32x16,
}

impl MipLevels {
    /// None yet.
    pub(in crate::render::cpu) const NONE: Self = Self { fine: I32x16::ZERO, blend: F32x16::ZERO };

    /// Of footprints: the greater squared length in tiles² that a step of one pixel right or down makes. The level is half
    /// its binary logarithm in texels², the mantissa taken as linear.
    #[inline(always)]
    pub(in crate::render::cpu) fn set<S: Simd>(&mut self, footprint: S::F) {
        const TEXELS: f32 = (SIDE * SIDE) as f32;
        let texels = (footprint * S::F::splat(TEXELS)).max(S::F::splat(1.0)).min(S::F::splat(TEXELS * 0.999));
        // In 1/256 levels.
        let level = (texels.bitcast_i32() - S::I::splat(1.0_f32.to_bits().cast_signed())).shr_logical::<16>();
        level.shr_logical::<8>().store(&mut self.fine);
        let blend = ((level & S::I::splat(255)) - S::I::splat(BLEND_FROM)).to_f32() * S::F::splat(BLEND_RATE);
        blend.max(S::F::splat(0.0)).min(S::F::splat(1.0)).store(&mut self.blend);
    }

    /// One of them.
    #[inline(always)]
    pub(in crate::render::cpu) fn get(&self, i: usize) -> MipLevel {
        MipLevel { fine: self.fine.0[i], blend: self.blend.0[i] }
    }
}

/// Where to read a texture for sixteen pixels. Finding samples and reading them are kept apart, so that a processor can
/// work on several tiles at a time: each step's chain of dependent instructions is long.
pub(in crate::render::cpu) struct TextureSample {
    /// Points in 1/256 texel of the level.
    at: [I32x16; 2],
    level: MipLevel,
}

impl TextureSample {
    /// No sample yet.
    pub(in crate::render::cpu) const NONE: Self =
        Self { at: [I32x16::ZERO; 2], level: MipLevel { fine: 0, blend: 0.0 } };

    /// Finds where to read.
    #[inline(always)]
    pub(in crate::render::cpu) fn locate<S: Simd>(&mut self, uv: &Uv<S>, level: MipLevel) {
        self.level = level;
        // 1/256 texel per tile: 2^(16 − level), built from its exponent.
        let exponent = (127 + SIDE.ilog2() + FRACTION_BITS).cast_signed() - level.fine;
        let scale = S::F::splat(f32::from_bits((exponent << 23).cast_unsigned()));
        for (t, at) in uv.iter().zip(&mut self.at) {
            (*t * scale).round_to_i32().store(at);
        }
    }

    /// Tile4x4 roots of the linear factors of red, green and blue, in [0, 1].
    #[inline(always)]
    pub(in crate::render::cpu) fn read<S: Simd>(&self, pattern: &MipChain) -> [S::F; 3] {
        let MipLevel { fine, blend } = self.level;
        let points = each!(k in 2 => S::I::load(&self.at[k]));
        // Coordinates run one way along a surface, so the least are most often at a corner of the tile.
        let least = each!(k in 2 => {
            let at = &self.at[k].0;
            at[0].min(at[3]).min(at[12]).min(at[15])
        });
        let coarser = each!(k in 2 => points[k].shr_arithmetic::<1>());
        let least_coarser = [least[0] >> 1, least[1] >> 1];
        let root = if blend == 0.0 {
            filtered::<S>(pattern, fine, points, least)
        } else if blend == 1.0 {
            filtered::<S>(pattern, fine + 1, coarser, least_coarser)
        } else {
            let (root, share) = (filtered::<S>(pattern, fine, points, least), S::F::splat(blend));
            let coarse = filtered::<S>(pattern, fine + 1, coarser, least_coarser);
            each!(c in 3 => (coarse[c] - root[c]).mul_add(share, root[c]))
        };
        each!(c in 3 => root[c] * S::F::splat(1.0 / 65280.0))
    }
}

/// Weighed sums of red, green and blue of the four texels around points of a level in 1/256 texel; 65280 is 1. `least`
/// is about the least of the points.
#[inline(always)]
fn filtered<S: Simd>(pattern: &MipChain, level: i32, points: [S::I; 2], least: [i32; 2]) -> [S::F; 3] {
    let whole = S::I::splat;
    let [x, y] = each!(k in 2 => points[k] - whole(HALF));
    let texels = texels::<S>(pattern, level, [x, y], least);
    // In both halves of a lane.
    let [fx, fy] = each!(k in 2 => {
        let fraction = [x, y][k] & whole(255);
        fraction | fraction.shl::<16>()
    });
    let corner = fx.mul_i16(fy).shr_logical_u16::<8>();
    let weights = [whole(0x0100_0100) + corner - fx - fy, fx - corner, fy - corner, corner];
    let (mut red_blue, mut green) = (whole(0), whole(0));
    for k in 0..4 {
        red_blue = red_blue + (texels[k] & whole(0x00FF_00FF)).mul_i16(weights[k]);
        // The upper half's alpha comes along and is dropped at the end.
        green = green + texels[k].shr_logical_u16::<8>().mul_i16(weights[k]);
    }
    [
        (red_blue & whole(0xFFFF)).to_f32(),
        (green & whole(0xFFFF)).to_f32(),
        red_blue.shr_logical::<16>().to_f32(),
    ]
}

/// The four texels around points in 1/256 texel: upper left, upper right, lower left, lower right.
#[inline(always)]
fn texels<S: Simd>(pattern: &MipChain, level: i32, points: [S::I; 2], least: [i32; 2]) -> [S::I; 4] {
    let whole = S::I::splat;
    let mask = (SIDE as i32 >> level) - 1;
    let (first, pitch) = (level_offset(level as usize), pitch(level as usize));
    let [x, y] = each!(k in 2 => points[k].shr_arithmetic::<FRACTION_BITS>());
    let corner = each!(k in 2 => (least[k] - HALF) >> FRACTION_BITS);
    let [left, top] = each!(k in 2 => (corner[k] & mask) as usize);
    let within = [x - whole(corner[0]), y - whole(corner[1])];
    if let Some(texels) = S::gather_window(&pattern.texels, first + top * pitch + left, pitch, within) {
        return texels;
    }
    let upper = ((y & whole(mask)).dot_i16(whole(pitch as i32)) + whole(first as i32)) + (x & whole(mask));
    let lower = upper + whole(pitch as i32);
    let (mut at_upper, mut at_lower) = (I32x16::ZERO, I32x16::ZERO);
    upper.store(&mut at_upper);
    lower.store(&mut at_lower);
    let ((a, b), (c, d)) =
        (S::gather_pairs(&pattern.texels, &at_upper), S::gather_pairs(&pattern.texels, &at_lower));
    [a, b, c, d]
}
