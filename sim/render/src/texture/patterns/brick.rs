//! Brickwork in different bonds.

use crate::texture::colour::{Rgb, TextureFn, hex, mix, pick, shade};
use crate::texture::layout::{self, LayoutRect};
use crate::texture::noise::{Fbm, Noise, Warp};
use crate::texture::shaping::smooth_step;

/// Brickwork: colours, mortar, roughness and worn edges.
struct Masonry<const N: usize> {
    palette: [Rgb; N],
    mortar: Rgb,
    /// Half the width of a mortar joint, in tiles.
    joint: f32,
    cell_noise: Noise,
    rough: Fbm,
    warp: Warp,
}

impl<const N: usize> Masonry<N> {
    /// Creates brickwork of a layout whose ids have `n` columns and rows.
    fn new(seed: u64, n: [i32; 2], joint: f32, palette: [u32; N], mortar: u32) -> Self {
        Self {
            palette: hex(palette),
            mortar: hex([mortar])[0],
            joint,
            cell_noise: Noise::new(seed, n),
            rough: Fbm::new(seed + 1, [20, 20], 3, 0.7),
            warp: Warp::new(seed + 5, 32, 1, 0.012),
        }
    }

    /// Returns the colour at (`u`, `v`), given the layout of the bricks.
    fn at(&self, u: f32, v: f32, lay: impl Fn(f32, f32) -> LayoutRect) -> Rgb {
        let rough = self.rough.at(u, v);
        let (u, v) = self.warp.at(u, v);
        let block = lay(u, v);
        let random = self.cell_noise.at_node(block.id[0], block.id[1]);
        let worn = 0.75 + 0.25 * smooth_step(self.joint, 3.0 * self.joint, block.edge_distance);
        let face = shade(pick(&self.palette, random), worn * (0.55 + 0.9 * rough));
        let joint = smooth_step(self.joint - 0.0015, self.joint + 0.0015, block.edge_distance);
        mix(shade(self.mortar, 0.75 + 0.5 * rough), face, joint)
    }
}

/// Red stretchers in running bond.
pub(crate) fn red() -> TextureFn {
    let palette = [0x9C4A34, 0xA85A40, 0x8A3D2C, 0xB4674C, 0x74342A];
    let wall = Masonry::new(200, [4, 10], 0.0075, palette, 0xBDB2A2);
    Box::new(move |u, v| wall.at(u, v, |u, v| layout::courses(u, v, [4, 10], 0.5)))
}

/// Buff bricks in Flemish bond.
pub(crate) fn flemish() -> TextureFn {
    let palette = [0xC9A46A, 0xD8B87E, 0xB58E58, 0x9A7448, 0xCDB083];
    let wall = Masonry::new(220, [6, 8], 0.0075, palette, 0x6E655B);
    Box::new(move |u, v| wall.at(u, v, |u, v| layout::flemish(u, v, [3, 8])))
}

/// Whitewashed bricks in stack bond.
pub(crate) fn white() -> TextureFn {
    let palette = [0xE9E5DC, 0xDFDAD0, 0xF1EEE8, 0xD2CCC1];
    let wall = Masonry::new(240, [3, 9], 0.008, palette, 0x8C867D);
    Box::new(move |u, v| wall.at(u, v, |u, v| layout::courses(u, v, [3, 9], 0.0)))
}

/// Dark clinker bricks in basket weave, in pairs.
pub(crate) fn basket() -> TextureFn {
    let palette = [0x5B3C3E, 0x6C474A, 0x4A3038, 0x7A5350];
    let wall = Masonry::new(260, [4, 8], 0.008, palette, 0xA79A8B);
    Box::new(move |u, v| wall.at(u, v, |u, v| layout::basket(u, v, 4, 2)))
}

/// Large grey blocks with pores, in running bond.
pub(crate) fn cinder_block() -> TextureFn {
    let wall = Masonry::new(280, [2, 4], 0.010, [0x8F9193, 0x9B9C9C, 0x83868A], 0xC6C4BE);
    let pores = Noise::new(300, [48, 48]);
    Box::new(move |u, v| {
        let pore = smooth_step(0.72, 0.9, pores.at(u, v));
        shade(wall.at(u, v, |u, v| layout::courses(u, v, [2, 4], 0.5)), 1.0 - 0.45 * pore)
    })
}
