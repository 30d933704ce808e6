//! Procedural patterns with their mip-maps. Each is a square tile that repeats without a seam; its texels are linear
//! factors by which a paint's colour is multiplied.

use super::noise::Noise;
use crate::scene::Texture;

/// Side of level 0 in texels.
pub(super) const SIDE: usize = 512;
/// Binary logarithm of the distance between rows in texels, the same in all levels.
pub(super) const PITCH_BITS: u32 = SIDE.ilog2();
/// Level 0 and, below it, all the others take fewer than twice its rows.
const N_TEXELS: usize = 2 * SIDE * SIDE;

/// One pattern.
pub(super) struct Pattern {
    /// World length of a tile's side, in m.
    pub(super) tile_m: f32,
    /// Levels from the finest down to one texel, one below the other, all beginning in column 0. A texel is its red,
    /// green and blue in 16 bits each from the lowest up, 255 a factor of 1: room to weigh all three in one
    /// multiplication.
    texels: Box<[u64; N_TEXELS]>,
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
        let mut texels = vec![0; N_TEXELS];
        let mut side = SIDE;
        while side > 0 {
            let first_row = Self::first_row(side as u32) as usize;
            for (i, rgb) in level.iter().enumerate() {
                texels[(first_row + i / side) * SIDE + i % side] = pack(*rgb);
            }
            level = halved(&level, side);
            side /= 2;
        }
        Self { tile_m, texels: texels.into_boxed_slice().try_into().expect("N_TEXELS long") }
    }

    /// First row of the level with `side` texels.
    #[inline(always)]
    pub(super) fn first_row(side: u32) -> u32 {
        2 * (SIDE as u32 - side)
    }

    /// A texel by its place: row · `SIDE` + column.
    #[inline(always)]
    pub(super) fn texel(&self, place: u32) -> u64 {
        self.texels[place as usize % N_TEXELS]
    }
}

fn pack(rgb: [f32; 3]) -> u64 {
    let [r, g, b] = rgb.map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u64);
    r | g << 16 | b << 32
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
    let (tone, warp, grain, pores) = (
        Noise::new(1, [BOARDS, 1]),
        Noise::new(2, [16, 3]),
        Noise::new(3, [160, 5]),
        Noise::new(4, [256, 24]),
    );
    Box::new(move |u, v| {
        let across = u * BOARDS as f32;
        let board = across as u32;
        let shift = tone.at_node(board, 0);
        let along = (v + shift).fract();
        let bent = u + 0.007 * (warp.at(u, along) - 0.5);
        let joint = smooth_step(0.0, 0.035, (across.fract() - 0.5).abs() - 0.48);
        let end = smooth_step(0.0, 0.004, (along - 0.5).abs() - 0.4975);
        let ring = ring_wave(bent * 46.0 + 1.3 * warp.at(along, u));
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
