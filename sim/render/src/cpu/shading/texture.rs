//! Texture sampling with bilinear filtering, for sixteen pixels at a time.

use crate::cpu::simd::each::each;
use crate::cpu::simd::{FloatLike, I32x16, Simd, SimdF32, SimdI32};
use crate::texture::{PITCH, SIDE, TextureImage};

/// Fractional bits of a fixed-point texel coordinate.
const FRACTION_BITS: u32 = 8;
/// Half a texel: the offset from the corner of a texel to its centre.
const HALF: i32 = 1 << (FRACTION_BITS - 1);

/// Texture coordinates of sixteen pixels, in texture tiles.
pub(crate) type Uv<S> = [<S as Simd>::F; 2];

/// The points at which sixteen pixels sample a texture. Locating samples and reading them are separate
/// steps, so that a CPU can overlap several tiles: the dependency chain of each step is long.
pub(crate) struct TextureSample {
    /// Points in 1/256 texel.
    points: [I32x16; 2],
}

impl TextureSample {
    /// Placeholder before the first call of [`Self::locate`].
    pub(crate) const NONE: Self = Self { points: [I32x16::ZERO; 2] };

    /// Computes the sample points for texture coordinates `uv`.
    #[inline(always)]
    pub(crate) fn locate<S: Simd>(&mut self, uv: &Uv<S>) {
        let scale = S::F::splat((SIDE << FRACTION_BITS) as f32);
        for (t, points) in uv.iter().zip(&mut self.points) {
            (*t * scale).round_to_i32().store(points);
        }
    }

    /// Reads the texture with bilinear filtering. Returns the square roots of the linear RGB factors, in
    /// [0, 1].
    #[inline(always)]
    pub(crate) fn read<S: Simd>(&self, image: &TextureImage) -> [S::F; 3] {
        // Coordinates are usually monotonic across a tile, so their minima are usually at its corners.
        let min = each!(k in 2 => {
            let points = &self.points[k].0;
            points[0].min(points[3]).min(points[12]).min(points[15])
        });
        let root = bilinear::<S>(image, each!(k in 2 => S::I::load(&self.points[k])), min);
        each!(c in 3 => root[c] * S::F::splat(1.0 / 65280.0))
    }
}

/// Returns the bilinearly filtered red, green and blue, scaled by 65280, at points in 1/256 texel. `min` is
/// the approximate minimum of the points.
#[inline(always)]
fn bilinear<S: Simd>(image: &TextureImage, points: [S::I; 2], min: [i32; 2]) -> [S::F; 3] {
    let splat = S::I::splat;
    let [x, y] = each!(k in 2 => points[k] - splat(HALF));
    let texels = gather_texels::<S>(image, [x, y], min);
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
/// Reads one window of texels if all points fit into it, and gathers otherwise.
#[inline(always)]
fn gather_texels<S: Simd>(image: &TextureImage, points: [S::I; 2], min: [i32; 2]) -> [S::I; 4] {
    const MASK: i32 = SIDE as i32 - 1;
    let splat = S::I::splat;
    let [x, y] = each!(k in 2 => points[k].shr_arithmetic::<FRACTION_BITS>());
    // Lanes that show another triangle may hold any point.
    let corner = each!(k in 2 => min[k].wrapping_sub(HALF) >> FRACTION_BITS);
    let [left, top] = each!(k in 2 => (corner[k] & MASK) as usize);
    let within = [x - splat(corner[0]), y - splat(corner[1])];
    if let Some(texels) = S::gather_window(&image.texels, top * PITCH + left, PITCH, within) {
        return texels;
    }
    let upper = (y & splat(MASK)).dot_i16(splat(PITCH as i32)) + (x & splat(MASK));
    let lower = upper + splat(PITCH as i32);
    let (mut at_upper, mut at_lower) = (I32x16::ZERO, I32x16::ZERO);
    upper.store(&mut at_upper);
    lower.store(&mut at_lower);
    let ((a, b), (c, d)) =
        (S::gather_pairs(&image.texels, &at_upper), S::gather_pairs(&image.texels, &at_lower));
    [a, b, c, d]
}
