//! Procedural patterns with their mip-maps. Each is a square tile that repeats without a seam; its texels are linear
//! factors by which a paint's colour is multiplied.
//!
//! `recipes` lists how each texture is drawn, one file per family holds the drawing, and this file owns the texels.
//! Only additions, multiplications, divisions, square roots, floors and comparisons are used, so that a texel is the
//! same on every machine. Nothing here knows how a pattern is filtered.

mod colour;
mod layout;
pub(super) mod noise;
mod patterns;
mod shaping;
#[cfg(test)]
mod tests;
mod voronoi;

use std::sync::OnceLock;

use crate::scene::Texture;
use colour::Rgb;

/// Side of level 0 in texels.
pub(super) const SIDE: usize = 256;
/// Levels from `SIDE` texels a side down to one.
pub(super) const N_LEVELS: usize = SIDE.ilog2() as usize + 1;
/// Texels that each row and each column of a level repeats behind its end.
const APRON: usize = 8;
/// Texels of all levels, the repeated ones included.
const N_TEXELS: usize = level_offset(N_LEVELS);

/// The patterns drawn so far. They are constants that are too large to be written down: the same in every process,
/// never changed, a function of nothing. Hence a static, which spares every caller from handing them through; each is
/// drawn when it is first asked for, since a scene shows but a few.
static PATTERNS: [OnceLock<MipChain>; Texture::ALL.len()] = [const { OnceLock::new() }; Texture::ALL.len()];

/// One pattern.
pub(super) struct MipChain {
    /// World length of a tile's side, in m.
    pub(super) tile_m: f32,
    /// Levels from the finest down to one texel, one after the other, each row by row. Rows and columns go on for eight
    /// texels behind their end, so that a square of so many from any texel on can be read without a seam. A texel is its
    /// red, green and blue in 8 bits each from the lowest up and then 255; a channel is 255 times the square root of the
    /// factor, which spends the codes where the eye tells them apart.
    pub(super) texels: Box<[u32]>,
}

/// The pattern of a texture.
pub(super) fn mip_chain(texture: Texture) -> &'static MipChain {
    PATTERNS[texture as usize].get_or_init(|| MipChain::new(texture))
}

/// Index of the first texel of a level, the finest being 0: as many as the finer ones hold.
pub(super) const fn level_offset(level: usize) -> usize {
    const OFFSETS: [usize; N_LEVELS + 1] = {
        let mut offsets = [0; N_LEVELS + 1];
        let mut level = 0;
        while level < N_LEVELS {
            offsets[level + 1] = offsets[level] + pitch(level) * pitch(level);
            level += 1;
        }
        offsets
    };
    OFFSETS[level]
}

/// Rows of a level, and distance between them, in texels.
pub(super) const fn pitch(level: usize) -> usize {
    (SIDE >> level) + APRON
}

impl MipChain {
    fn new(texture: Texture) -> Self {
        let (tile_m, shade) = patterns::recipe(texture);
        let mut level = drawn(&*shade);
        let mut texels = Vec::with_capacity(N_TEXELS);
        let mut side = SIDE;
        while side > 0 {
            let on = 0..side + APRON;
            texels.extend(on.clone().flat_map(|y| {
                let row = &level[y % side * side..][..side];
                on.clone().map(|x| pack(row[x % side]))
            }));
            level = halved(&level, side);
            side /= 2;
        }
        debug_assert_eq!(texels.len(), N_TEXELS);
        Self { tile_m, texels: texels.into_boxed_slice() }
    }
}

/// Level 0. Where a texel differs from a neighbour an edge may cross it: there it is the mean of four samples, so that
/// a family may draw its edges sharp. Elsewhere its middle will do.
fn drawn(shade: &dyn Fn(f32, f32) -> Rgb) -> Vec<Rgb> {
    const LEAST_EDGE: f32 = 0.18;
    let middles: Vec<Rgb> = (0..SIDE * SIDE).map(|i| averaged(shade, i, 1)).collect();
    let differ = |a: Rgb, b: Rgb| (0..3).any(|c| (a[c] - b[c]).abs() > LEAST_EDGE);
    let texel = |i: usize| {
        let (x, y) = (i % SIDE, i / SIDE);
        let around = [(x + 1, y), (x + SIDE - 1, y), (x, y + 1), (x, y + SIDE - 1)];
        let crossed = around.iter().any(|(x, y)| differ(middles[y % SIDE * SIDE + x % SIDE], middles[i]));
        if crossed { averaged(shade, i, 2) } else { middles[i] }
    };
    (0..SIDE * SIDE).map(texel).collect()
}

/// Mean of n × n samples spread evenly over texel `i`.
fn averaged(shade: &dyn Fn(f32, f32) -> Rgb, i: usize, n: usize) -> Rgb {
    let at = |texel: usize, k: usize| (texel as f32 + (k as f32 + 0.5) / n as f32) / SIDE as f32;
    let mut sum = [0.0; 3];
    for k in 0..n * n {
        let sample = shade(at(i % SIDE, k % n), at(i / SIDE, k / n));
        sum = core::array::from_fn(|c| sum[c] + sample[c]);
    }
    sum.map(|c| c / (n * n) as f32)
}

/// The next coarser level: each texel the mean of four.
fn halved(level: &[Rgb], side: usize) -> Vec<Rgb> {
    let half = side / 2;
    let texel = |i: usize| {
        let (x, y) = (i % half * 2, i / half * 2);
        let four = [y * side + x, y * side + x + 1, (y + 1) * side + x, (y + 1) * side + x + 1];
        core::array::from_fn(|c| four.iter().map(|&k| level[k][c]).sum::<f32>() / 4.0)
    };
    (0..half * half).map(texel).collect()
}

fn pack(rgb: Rgb) -> u32 {
    let [r, g, b] = rgb.map(|c| (c.clamp(0.0, 1.0).sqrt() * 255.0 + 0.5) as u8);
    u32::from_le_bytes([r, g, b, 255])
}
