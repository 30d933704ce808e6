//! Procedural patterns with their mip-maps. Each is a square tile that repeats without a seam; its texels are linear
//! factors by which a paint's colour is multiplied.

use super::noise::Noise;
use crate::scene::Texture;

/// Side of level 0 in texels.
const SIDE: usize = 512;
/// Levels down to one texel.
const N_LEVELS: usize = SIDE.ilog2() as usize + 1;

/// One pattern.
pub(super) struct Pattern {
    /// World length of a tile's side, in m.
    pub(super) tile_m: f32,
    /// All levels one after another, the finest first; a texel is `0x00BBGGRR`, 255 is a factor of 1.
    texels: Vec<u32>,
    /// Where each level starts.
    starts: [usize; N_LEVELS],
}

impl Pattern {
    /// The pattern `texture`.
    pub(super) fn new(texture: Texture) -> Self {
        let (tile_m, shade): (f32, Shade) = match texture {
            Texture::Wood => (1.2, wood()),
            Texture::Checker => (4.0, checker()),
            Texture::BrushedMetal => (0.4, brushed_metal()),
            Texture::Plaster => (1.0, plaster()),
        };
        let finest = (0..SIDE * SIDE).map(|i| {
            let centre = |i: usize| (i as f32 + 0.5) / SIDE as f32;
            shade(centre(i % SIDE), centre(i / SIDE))
        });
        let mut level: Vec<[f32; 3]> = finest.collect();
        let mut texels = Vec::with_capacity(SIDE * SIDE * 4 / 3 + 1);
        let starts = core::array::from_fn(|l| {
            let start = texels.len();
            texels.extend(level.iter().map(|rgb| pack(*rgb)));
            level = halved(&level, SIDE >> l);
            start
        });
        Self { tile_m, texels, starts }
    }

    /// Factors of red, green and blue, in [0, 1], at (`u`, `v`) in tiles, filtered over a pixel whose longer side spans
    /// √`footprint` tiles: bilinear within the two nearest levels, linear between them.
    #[inline(always)]
    pub(super) fn sample(&self, u: f32, v: f32, footprint: f32) -> [f32; 3] {
        let level = level_of(footprint);
        let (fine, blend) = (level >> 8, u64::from(level & 255));
        let near = self.bilinear(fine as usize, u, v);
        let far = self.bilinear((fine as usize + 1).min(N_LEVELS - 1), u, v);
        let mixed = near * (256 - blend) + far * blend;
        [mixed & 0xFFFF, (mixed >> 32) & 0xFFFF, (mixed >> 16) & 0xFFFF].map(|lane| lane as f32 / 65280.0)
    }

    /// Four 8-bit channels in 16-bit lanes, in the order of [`spread`].
    #[inline(always)]
    fn bilinear(&self, level: usize, u: f32, v: f32) -> u64 {
        let side = SIDE >> level;
        let mask = side as i32 - 1;
        // In 1/256 texel. Tiles far from the origin are many texels away: i32 holds 16,384 tiles.
        let fixed = |t: f32| (t * (side as f32 * 256.0)) as i32 - 128;
        let (x, y) = (fixed(u), fixed(v));
        let (fx, fy) = ((x & 255) as u64, (y & 255) as u64);
        let corner = fx * fy >> 8;
        let weights = [256 - fx - fy + corner, fx - corner, fy - corner, corner];
        let column = |dx: i32| (((x >> 8) + dx) & mask) as usize;
        let row = |dy: i32| (((y >> 8) + dy) & mask) as usize * side;
        let texels = &self.texels[self.starts[level]..self.starts[level] + side * side];
        let taps = [row(0) + column(0), row(0) + column(1), row(1) + column(0), row(1) + column(1)];
        let sum: u64 = taps.iter().zip(weights).map(|(&tap, weight)| spread(texels[tap]) * weight).sum();
        (sum >> 8) & 0x00FF_00FF_00FF_00FF
    }
}

/// Mip level in 1/256 levels: half the binary logarithm of the footprint in texels², its mantissa taken as linear.
#[inline(always)]
fn level_of(footprint: f32) -> u32 {
    let texels = (footprint * (SIDE * SIDE) as f32).clamp(1.0, (SIDE * SIDE) as f32 * 0.999);
    ((texels.to_bits() - 1.0_f32.to_bits()) >> 15) / 2
}

/// Bytes 0, 2, 1, 3 of a texel in 16-bit lanes from the lowest up.
#[inline(always)]
fn spread(texel: u32) -> u64 {
    let texel = u64::from(texel);
    (texel & 0x00FF_00FF) | ((texel & 0xFF00_FF00) << 24)
}

fn pack(rgb: [f32; 3]) -> u32 {
    let [r, g, b] = rgb.map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u32);
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

/// Linear factors at a point of the tile, both coordinates in [0, 1).
type Shade = Box<dyn Fn(f32, f32) -> [f32; 3]>;

/// Boards along v, each with its own tone, long grain and a fine dark joint.
fn wood() -> Shade {
    const BOARDS: u32 = 8;
    let (tone, warp, grain, pores) =
        (Noise::new(1, [BOARDS, 1]), Noise::new(2, [16, 3]), Noise::new(3, [160, 5]), Noise::new(4, [256, 24]));
    Box::new(move |u, v| {
        let across = u * BOARDS as f32;
        let board = across as u32;
        let shift = tone.at_node(board, 0);
        let along = (v + shift).fract();
        let bent = u + 0.012 * (warp.at(u, along) - 0.5);
        let joint = smooth_step(0.0, 0.035, (across.fract() - 0.5).abs() - 0.48);
        let end = smooth_step(0.0, 0.004, (along - 0.5).abs() - 0.4975);
        let ring = ring_wave(bent * 46.0 + 2.5 * warp.at(along, u));
        let fibre = 0.6 * grain.at(bent, along) + 0.4 * pores.at(bent, along);
        let light = 0.80 + 0.16 * shift + 0.10 * (fibre - 0.5) - 0.07 * ring;
        let light = light * (1.0 - 0.45 * joint.max(end));
        let warmth = 0.06 * (1.0 - light) + 0.03 * shift;
        [light, light * (0.99 - warmth), light * (0.97 - 2.0 * warmth)]
    })
}

/// Squares of 1 m, light and dark, with a thin line at every edge.
fn checker() -> Shade {
    const SQUARES: f32 = 4.0;
    let speckle = Noise::new(5, [128, 128]);
    Box::new(move |u, v| {
        let (x, y) = (u * SQUARES, v * SQUARES);
        let dark = (x as u32 + y as u32) % 2 == 1;
        let edge = |t: f32| 0.5 - (t.fract() - 0.5).abs();
        let line = 1.0 - smooth_step(0.006, 0.014, edge(x).min(edge(y)));
        let tone = if dark { 0.52 } else { 0.88 } + 0.04 * (speckle.at(u, v) - 0.5);
        [tone * (1.0 - 0.5 * line); 3]
    })
}

/// Fine streaks along u.
fn brushed_metal() -> Shade {
    let (fine, broad) = (Noise::new(6, [8, 256]), Noise::new(7, [3, 64]));
    Box::new(move |u, v| {
        let tone = 0.80 + 0.22 * (fine.at(u, v) - 0.5) + 0.16 * (broad.at(u, v) - 0.5);
        [tone, tone, tone * 1.01]
    })
}

/// Soft blotches and grain.
fn plaster() -> Shade {
    let octaves = [5, 11, 24, 53, 120].map(|n| Noise::new(8 + u64::from(n), [n, n]));
    Box::new(move |u, v| {
        let weights = [0.34, 0.24, 0.18, 0.14, 0.10];
        let relief: f32 = octaves.iter().zip(weights).map(|(noise, weight)| weight * noise.at(u, v)).sum();
        let tone = 0.86 + 0.42 * (relief - 0.5);
        [tone, tone * 0.995, tone * 0.985]
    })
}

/// A growth ring: rises slowly over one period and falls quickly.
fn ring_wave(t: f32) -> f32 {
    let phase = t - t.floor();
    smooth_step(0.0, 0.8, phase) - smooth_step(0.85, 1.0, phase)
}

fn smooth_step(lo: f32, hi: f32, x: f32) -> f32 {
    let t = ((x - lo) / (hi - lo)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::{N_LEVELS, Pattern, SIDE, level_of};
    use crate::scene::Texture;

    #[test]
    fn patterns_repeat_and_coarsen_to_their_mean() {
        for texture in [Texture::Wood, Texture::Checker, Texture::BrushedMetal, Texture::Plaster] {
            let pattern = Pattern::new(texture);
            assert_eq!(pattern.sample(0.3, 0.7, 1e-9), pattern.sample(2.3, -1.3, 1e-9));
            let mean = pattern.sample(0.1, 0.2, 1.0);
            assert!(mean.iter().all(|c| (0.4..0.95).contains(c)), "{texture:?}: {mean:?}");
            assert_eq!(pattern.texels.len(), (0..N_LEVELS).map(|l| (SIDE >> l) * (SIDE >> l)).sum::<usize>());
        }
    }

    #[test]
    fn a_pixel_that_spans_more_texels_takes_a_coarser_level() {
        let texel = 1.0 / SIDE as f32;
        assert_eq!(level_of(texel * texel), 0);
        assert_eq!(level_of(16.0 * texel * texel), 2 << 8);
        assert_eq!(level_of(f32::NAN.max(0.0)), 0);
        assert!((level_of(1e9) >> 8) as usize == N_LEVELS - 2);
    }
}
