//! Procedural textures. Each is a square tile that repeats seamlessly; its texels are linear factors that
//! multiply an albedo.
//!
//! `patterns` lists the textures, with one file per family; this file rasterises them. Only additions,
//! multiplications, divisions, square roots, floors and comparisons are used, so every texel is the same on
//! every machine. Sampling belongs to the renderers.

mod colour;
mod layout;
pub(crate) mod noise;
mod patterns;
mod shaping;
mod size;
#[cfg(test)]
mod tests;
mod voronoi;

use std::sync::OnceLock;

use colour::Rgb;
use scene::Texture;
pub(crate) use size::{PITCH, SIDE};

/// Cache of generated textures. They are constants that are too large to write down, so a static holds them
/// and no caller has to pass them around. Each is generated on first use, because a scene shows only a few.
static IMAGES: [OnceLock<TextureImage>; Texture::ALL.len()] = [const { OnceLock::new() }; Texture::ALL.len()];

/// The texels of a texture.
pub(crate) struct TextureImage {
    /// World length of a tile's side, in m.
    pub(crate) tile_m: f32,
    /// `PITCH` rows of `PITCH` texels. A texel is RGBA8 with red in the lowest byte and alpha 255. A channel
    /// is 255 times the square root of the factor: the quantisation is then closer to perceptually uniform.
    pub(crate) texels: Box<[u32]>,
}

/// Returns the texels of a texture, generating them on first use.
pub(crate) fn image(texture: Texture) -> &'static TextureImage {
    IMAGES[texture as usize].get_or_init(|| {
        let (tile_m, texture_fn) = patterns::get(texture);
        let tile = rasterised(&*texture_fn);
        let texel = |i: usize| pack(tile[i / PITCH % SIDE * SIDE + i % PITCH % SIDE]);
        TextureImage { tile_m, texels: (0..PITCH * PITCH).map(texel).collect() }
    })
}

/// Rasterises a tile. A texel that differs strongly from a neighbour may contain an edge and is the mean of
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

fn pack(rgb: Rgb) -> u32 {
    let [r, g, b] = rgb.map(|c| (c.clamp(0.0, 1.0).sqrt() * 255.0 + 0.5) as u8);
    u32::from_le_bytes([r, g, b, 255])
}
