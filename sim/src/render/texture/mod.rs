//! Procedural textures and their mip levels. Each is a square tile that repeats seamlessly; its texels are
//! linear factors that multiply an albedo.
//!
//! `patterns` lists the textures, with one file per family; this file rasterises them. Only additions,
//! multiplications, divisions, square roots, floors and comparisons are used, so every texel is the same on
//! every machine. Texture filtering belongs to the renderers.

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

/// Side of mip level 0, in texels.
pub(super) const SIDE: usize = 256;
/// Number of mip levels, from `SIDE` × `SIDE` down to 1 × 1.
pub(super) const N_LEVELS: usize = SIDE.ilog2() as usize + 1;
/// Texels by which each row and column of a level continues periodically past its end.
const PADDING: usize = 8;
/// Texels of all levels, padding included.
const N_TEXELS: usize = level_offset(N_LEVELS);

/// Cache of generated textures. They are constants that are too large to write down, so a static holds them
/// and no caller has to pass them around. Each is generated on first use, because a scene shows only a few.
static MIP_CHAINS: [OnceLock<MipChain>; Texture::ALL.len()] = [const { OnceLock::new() }; Texture::ALL.len()];

/// A texture as a chain of mip levels.
pub(super) struct MipChain {
    /// World length of a tile's side, in m.
    pub(super) tile_m: f32,
    /// All levels from the finest to the coarsest, each in row-major order with [`pitch`] texels per row and
    /// as many rows. The eight texels of padding allow an 8 × 8 window to be read from any texel on without
    /// wrapping. A texel is RGBA8 with red in the lowest byte and alpha 255. A channel is 255 times the
    /// square root of the factor: the quantisation is then closer to perceptually uniform.
    pub(super) texels: Box<[u32]>,
}

/// Returns the mip chain of a texture, generating it on first use.
pub(super) fn mip_chain(texture: Texture) -> &'static MipChain {
    MIP_CHAINS[texture as usize].get_or_init(|| MipChain::new(texture))
}

/// Returns the index of the first texel of a level; level 0 is the finest.
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

/// Returns the row pitch of a level, in texels, which is also its number of rows.
pub(super) const fn pitch(level: usize) -> usize {
    (SIDE >> level) + PADDING
}

impl MipChain {
    fn new(texture: Texture) -> Self {
        let (tile_m, texture_fn) = patterns::get(texture);
        let mut level = rasterised(&*texture_fn);
        let mut texels = Vec::with_capacity(N_TEXELS);
        let mut side = SIDE;
        while side > 0 {
            let padded = 0..side + PADDING;
            texels.extend(padded.clone().flat_map(|y| {
                let row = &level[y % side * side..][..side];
                padded.clone().map(|x| pack(row[x % side]))
            }));
            level = downsampled(&level, side);
            side /= 2;
        }
        debug_assert_eq!(texels.len(), N_TEXELS);
        Self { tile_m, texels: texels.into_boxed_slice() }
    }
}

/// Rasterises level 0. A texel that differs strongly from a neighbour may contain an edge and is the mean of
/// four samples, so that patterns may have sharp edges. All others are sampled once, at the centre.
fn rasterised(texture_fn: &dyn Fn(f32, f32) -> Rgb) -> Vec<Rgb> {
    const MIN_CONTRAST: f32 = 0.18;
    let centres: Vec<Rgb> = (0..SIDE * SIDE).map(|i| averaged(texture_fn, i, 1)).collect();
    let differ = |a: Rgb, b: Rgb| (0..3).any(|c| (a[c] - b[c]).abs() > MIN_CONTRAST);
    let texel = |i: usize| {
        let (x, y) = (i % SIDE, i / SIDE);
        let around = [(x + 1, y), (x + SIDE - 1, y), (x, y + 1), (x, y + SIDE - 1)];
        let crossed = around.iter().any(|(x, y)| differ(centres[y % SIDE * SIDE + x % SIDE], centres[i]));
        if crossed { averaged(texture_fn, i, 2) } else { centres[i] }
    };
    (0..SIDE * SIDE).map(texel).collect()
}

/// Returns the mean of n × n evenly spaced samples of texel `i`.
fn averaged(texture_fn: &dyn Fn(f32, f32) -> Rgb, i: usize, n: usize) -> Rgb {
    let at = |texel: usize, k: usize| (texel as f32 + (k as f32 + 0.5) / n as f32) / SIDE as f32;
    let mut sum = [0.0; 3];
    for k in 0..n * n {
        let sample = texture_fn(at(i % SIDE, k % n), at(i / SIDE, k / n));
        sum = core::array::from_fn(|c| sum[c] + sample[c]);
    }
    sum.map(|c| c / (n * n) as f32)
}

/// Returns the next coarser level, a 2 × 2 box filter.
fn downsampled(level: &[Rgb], side: usize) -> Vec<Rgb> {
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
