//! Textures as the device reads them: square-root coded texels, level after level.

use crate::render::texture::{Pattern, SIDE as PATTERN_SIDE};

/// Texels along each edge of level 0.
const SIDE: usize = 256;
/// Words of a texture: every level's rows, each with one texel more than its side.
pub(super) const TILE_WORDS: usize = 87_892;

/// The texels of a pattern: levels from the finest down to one texel, each row followed by its first texel once more. A
/// texel is red, green and blue from the lowest byte up, each the square root of a linear factor.
pub(super) fn texels(pattern: &Pattern) -> Vec<u32> {
    // A level below the pattern's own, which is twice as fine.
    let mut level: Vec<[f32; 3]> = (0..SIDE * SIDE).map(|i| factor(pattern, i % SIDE, i / SIDE)).collect();
    let mut words = Vec::with_capacity(TILE_WORDS);
    let mut side = SIDE;
    while side > 0 {
        for row in level.chunks_exact(side) {
            words.extend(row.iter().chain(&row[..1]).map(coded));
        }
        level = halved(&level, side);
        side /= 2;
    }
    words
}

fn factor(pattern: &Pattern, x: usize, y: usize) -> [f32; 3] {
    let row = Pattern::first_row(SIDE as u32) as usize + y;
    let texel = pattern.texel((row * PATTERN_SIDE + x) as u32);
    core::array::from_fn(|c| (texel >> (16 * c) & 0xFF) as f32 / 255.0)
}

fn coded(rgb: &[f32; 3]) -> u32 {
    let [r, g, b] = rgb.map(|c| (c.sqrt() * 255.0 + 0.5) as u32);
    r | g << 8 | b << 16
}

/// The next coarser level: each texel the mean of four.
fn halved(level: &[[f32; 3]], side: usize) -> Vec<[f32; 3]> {
    let half = side / 2;
    let texel = |i: usize| {
        let (x, y) = (i % half * 2, i / half * 2);
        let four = [y * side + x, y * side + x + 1, (y + 1) * side + x, (y + 1) * side + x + 1];
        core::array::from_fn(|c| four.iter().map(|&k| level[k][c]).sum::<f32>() / 4.0)
    };
    (0..half * half).map(texel).collect()
}
