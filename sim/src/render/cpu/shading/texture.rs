//! Texture sampling with bilinear filtering and mip levels, for sixteen pixels at a time.

use crate::render::cpu::simd::each::each;
use crate::render::cpu::simd::{F32x16, FloatLike, I32x16, Simd, SimdF32, SimdI32};
use crate::render::texture::{MipChain, SIDE, level_offset, pitch};

/// Fractional bits of a fixed-point texel coordinate.
const FRACTION_BITS: u32 = 8;
/// Half a texel: the offset from the corner of a texel to its centre.
const HALF: i32 = 1 << (FRACTION_BITS - 1);
/// Fraction of a mip level, in 1/256, above which the next coarser level is blended in.
const BLEND_FROM: i32 = 96;
/// Blend weight per 1/256 level above [`BLEND_FROM`].
const BLEND_RATE: f32 = 4.0 / 256.0;

/// Texture coordinates of sixteen pixels, in texture tiles.
pub(in crate::render::cpu) type Uv<S> = [<S as Simd>::F; 2];

/// A mip level and its blend with the next coarser one, chosen once per pixel tile and triangle.
#[derive(Clone, Copy, PartialEq)]
pub(in crate::render::cpu) struct MipLevel {
    /// Number of the finer level.
    fine: i32,
    /// Weight of the next coarser level, in [0, 1].
    blend: f32,
}

/// The mip levels of sixteen pixel footprints.
pub(in crate::render::cpu) struct MipLevels {
    fine: I32x16,
    blend: F32x16,
}

impl MipLevels {
    /// Level 0 in all lanes.
    pub(in crate::render::cpu) const NONE: Self = Self { fine: I32x16::ZERO, blend: F32x16::ZERO };

    /// Sets the levels for the given footprints: the larger squared length, in texture tiles², of a step of
    /// one pixel to the right or down. The level is half the binary logarithm of the footprint in texels²,
    /// with the mantissa taken as linear.
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

    /// Returns the level of lane `i`.
    #[inline(always)]
    pub(in crate::render::cpu) fn get(&self, i: usize) -> MipLevel {
        MipLevel { fine: self.fine.0[i], blend: self.blend.0[i] }
    }
}

/// The points at which sixteen pixels sample a texture. Locating samples and reading them are separate
/// steps, so that a CPU can overlap several tiles: the dependency chain of each step is long.
pub(in crate::render::cpu) struct TextureSample {
    /// Points in 1/256 texel of the finer level.
    points: [I32x16; 2],
    level: MipLevel,
}

impl TextureSample {
    /// Placeholder before the first call of [`Self::locate`].
    pub(in crate::render::cpu) const NONE: Self =
        Self { points: [I32x16::ZERO; 2], level: MipLevel { fine: 0, blend: 0.0 } };

    /// Computes the sample points for texture coordinates `uv` at a mip level.
    #[inline(always)]
    pub(in crate::render::cpu) fn locate<S: Simd>(&mut self, uv: &Uv<S>, level: MipLevel) {
        self.level = level;
        // 1/256 texel per tile: 2^(16 − level), built from its exponent.
        let exponent = (127 + SIDE.ilog2() + FRACTION_BITS).cast_signed() - level.fine;
        let scale = S::F::splat(f32::from_bits((exponent << 23).cast_unsigned()));
        for (t, points) in uv.iter().zip(&mut self.points) {
            (*t * scale).round_to_i32().store(points);
        }
    }

    /// Reads the bilinear texture. Returns the square roots of the linear RGB factors, in [0, 1].
    #[inline(always)]
    pub(in crate::render::cpu) fn read<S: Simd>(&self, mips: &MipChain) -> [S::F; 3] {
        let MipLevel { fine, blend } = self.level;
        let points = each!(k in 2 => S::I::load(&self.points[k]));
        // Coordinates are usually monotonic across a tile, so their minima are usually at its corners.
        let min = each!(k in 2 => {
            let points = &self.points[k].0;
            points[0].min(points[3]).min(points[12]).min(points[15])
        });
        let coarser = each!(k in 2 => points[k].shr_arithmetic::<1>());
        let min_coarser = [min[0] >> 1, min[1] >> 1];
        let root = if blend == 0.0 {
            bilinear::<S>(mips, fine, points, min)
        } else if blend == 1.0 {
            bilinear::<S>(mips, fine + 1, coarser, min_coarser)
        } else {
            let (root, weight) = (bilinear::<S>(mips, fine, points, min), S::F::splat(blend));
            let coarse = bilinear::<S>(mips, fine + 1, coarser, min_coarser);
            each!(c in 3 => (coarse[c] - root[c]).mul_add(weight, root[c]))
        };
        each!(c in 3 => root[c] * S::F::splat(1.0 / 65280.0))
    }
}

/// Returns the bilinearly filtered red, green and blue, scaled by 65280, at points of a level in 1/256
/// texel. `min` is the approximate minimum of the points.
#[inline(always)]
fn bilinear<S: Simd>(mips: &MipChain, level: i32, points: [S::I; 2], min: [i32; 2]) -> [S::F; 3] {
    let splat = S::I::splat;
    let [x, y] = each!(k in 2 => points[k] - splat(HALF));
    let texels = gather_texels::<S>(mips, level, [x, y], min);
    // Repeat the fraction in both 16-bit halves of each lane.
    let [fx, fy] = each!(k in 2 => {
        let fraction = [x, y][k] & splat(255);
        fraction | fraction.shl::<16>()
    });
    let corner = fx.mul_i16(fy).shr_logical_u16::<8>();
    let weights = [splat(0x0100_0100) + corner - fx - fy, fx - corner, fy - corner, corner];
    let (mut red_blue, mut green) = (splat(0), splat(0));
    for k in 0..4 {
        red_blue = red_blue + (texels[k] & splat(0x00FF_00FF)).mul_i16(weights[k]);
        // The upper half accumulates alpha, which is masked out at the end.
        green = green + texels[k].shr_logical_u16::<8>().mul_i16(weights[k]);
    }
    [
        (red_blue & splat(0xFFFF)).to_f32(),
        (green & splat(0xFFFF)).to_f32(),
        red_blue.shr_logical::<16>().to_f32(),
    ]
}

/// Returns the four texels around points in 1/256 texel: upper left, upper right, lower left, lower right.
/// Reads one window of the level if all points fit into it, and gathers otherwise.
#[inline(always)]
fn gather_texels<S: Simd>(mips: &MipChain, level: i32, points: [S::I; 2], min: [i32; 2]) -> [S::I; 4] {
    let splat = S::I::splat;
    let mask = (SIDE as i32 >> level) - 1;
    let (first, pitch) = (level_offset(level as usize), pitch(level as usize));
    let [x, y] = each!(k in 2 => points[k].shr_arithmetic::<FRACTION_BITS>());
    let corner = each!(k in 2 => (min[k] - HALF) >> FRACTION_BITS);
    let [left, top] = each!(k in 2 => (corner[k] & mask) as usize);
    let within = [x - splat(corner[0]), y - splat(corner[1])];
    if let Some(texels) = S::gather_window(&mips.texels, first + top * pitch + left, pitch, within) {
        return texels;
    }
    let upper = ((y & splat(mask)).dot_i16(splat(pitch as i32)) + splat(first as i32)) + (x & splat(mask));
    let lower = upper + splat(pitch as i32);
    let (mut at_upper, mut at_lower) = (I32x16::ZERO, I32x16::ZERO);
    upper.store(&mut at_upper);
    lower.store(&mut at_lower);
    let ((a, b), (c, d)) =
        (S::gather_pairs(&mips.texels, &at_upper), S::gather_pairs(&mips.texels, &at_lower));
    [a, b, c, d]
}
