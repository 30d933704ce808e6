//! Glazed tiles with grout.

use crate::texture::colour::{Rgb, TextureFn, hex, mix, pick, shade};
use crate::texture::layout;
use crate::texture::noise::{Fbm, Noise};
use crate::texture::shaping::{distance_to_integer, fract, length, smooth_step, smooth_wave};
use crate::texture::voronoi::VoronoiCells;

/// Returns the colour at distance `edge` from the edge of a glazed tile: grout of half-width `joint`, then a
/// rounded rim, then the face. Lengths are in texture tiles.
fn glazed(face: Rgb, grout: Rgb, joint: f32, edge: f32) -> Rgb {
    let rim = 0.80 + 0.20 * smooth_step(joint, 2.5 * joint, edge);
    mix(grout, shade(face, rim), smooth_step(joint - 0.001, joint + 0.001, edge))
}

/// Turquoise squares of slightly different shades.
pub(crate) fn square() -> TextureFn {
    let (cell_noise, glaze) = (Noise::new(400, [5, 5]), Fbm::new(401, [6, 6], 3, 0.5));
    let palette = hex([0x2E9CA6, 0x3FB0B3, 0x2788A0, 0x55BDB5]);
    let grout = hex([0xE8E4DA])[0];
    Box::new(move |u, v| {
        let block = layout::courses(u, v, [5, 5], 0.0);
        let face = pick(&palette, cell_noise.at_node(block.id[0], block.id[1]));
        glazed(shade(face, 0.8 + 0.4 * glaze.at(u, v)), grout, 0.008, block.edge_distance)
    })
}

/// White, sage and black hexagons.
pub(crate) fn hexagon() -> TextureFn {
    let cells = VoronoiCells::new(410, [7, 8], 0.0);
    let palette = hex([0xEDEAE2, 0xE3DFD5, 0xA9B8A0, 0xEDEAE2, 0x2F3336]);
    let grout = hex([0x8B877F])[0];
    Box::new(move |u, v| {
        let cell = cells.at(u, v);
        glazed(pick(&palette, cell.random), grout, 0.006, cell.border_distance())
    })
}

/// Cream octagons with dark dots at their corners.
pub(crate) fn octagon() -> TextureFn {
    const N: f32 = 5.0;
    let cell_noise = Noise::new(420, [N as i32, N as i32]);
    let [cream, shadow, dot, grout] = hex([0xEFE3C8, 0xDCCBA6, 0x8C2F2B, 0x7B7266]);
    Box::new(move |u, v| {
        let (x, y) = (u * N, v * N);
        let random = cell_noise.at_node(x.floor() as i32, y.floor() as i32);
        // Signed distance from the side of the dot, which cuts the corner at 45°.
        let from_dot = (distance_to_integer(x) + distance_to_integer(y) - 0.34) * 0.5_f32.sqrt();
        if from_dot < 0.0 {
            return glazed(dot, grout, 0.006, -from_dot / N);
        }
        glazed(
            mix(cream, shadow, random),
            grout,
            0.006,
            from_dot.min(distance_to_integer(x)).min(distance_to_integer(y)) / N,
        )
    })
}

/// Small squares of many colours.
pub(crate) fn mosaic() -> TextureFn {
    const N: i32 = 14;
    let (cell_noise, drift) = (Noise::new(430, [N, N]), Noise::new(431, [4, 4]));
    let palette = hex([0x1F3F77, 0x2D66A6, 0x4A93BF, 0x8CC0C9, 0xD9C89A, 0xC98A3E]);
    let grout = hex([0xD8D3C8])[0];
    Box::new(move |u, v| {
        let block = layout::courses(u, v, [N, N], 0.0);
        let random = cell_noise.at_node(block.id[0], block.id[1]);
        // A low-frequency drift makes the colours of neighbours similar.
        let middle = [0, 1].map(|i: usize| (block.id[i] as f32 + 0.5) / N as f32);
        let blend = 0.55 * drift.at(middle[0], middle[1]) + 0.45 * random;
        glazed(
            shade(pick(&palette, 1.3 * blend - 0.12), 0.85 + 0.3 * fract(7.0 * random)),
            grout,
            0.006,
            block.edge_distance,
        )
    })
}

/// Bottle-green subway tiles with a bright reflection.
pub(crate) fn subway() -> TextureFn {
    let (cell_noise, glaze) = (Noise::new(440, [4, 8]), Fbm::new(441, [5, 5], 2, 0.5));
    let palette = hex([0x1F5B45, 0x26694F, 0x194C3B, 0x2F7A5C]);
    let [grout, shine] = hex([0xD5D6CC, 0xBFE0CF]);
    Box::new(move |u, v| {
        let block = layout::courses(u, v, [4, 8], 0.5);
        let face = pick(&palette, cell_noise.at_node(block.id[0], block.id[1]));
        let reflection =
            smooth_wave(block.across * 8.0 * 2.0 + 0.25) * smooth_step(0.6, 0.8, 1.0 - block.across * 8.0);
        let face = shade(mix(face, shine, 0.30 * reflection), 0.75 + 0.5 * glaze.at(u, v));
        glazed(face, grout, 0.007, block.edge_distance)
    })
}

/// Rows of overlapping scales.
pub(crate) fn fish_scale() -> TextureFn {
    const COLS: f32 = 5.0;
    const ROWS: f32 = 2.0 * COLS;
    const RADIUS: f32 = 0.5 / COLS;
    let cell_noise = Noise::new(450, [COLS as i32, ROWS as i32]);
    let palette = hex([0xE58C73, 0xD96C5F, 0xF0B08E, 0xC9505A, 0xF3C7A5]);
    let grout = hex([0xFBF3E6])[0];
    // Vector from the centre of the nearest scale of a row, and the id of that scale.
    let scale = |u: f32, v: f32, row: i32| {
        let x = u * COLS + 0.5 * (row & 1) as f32;
        ([(fract(x) - 0.5) / COLS, v - row as f32 / ROWS], [x.floor() as i32, row])
    };
    Box::new(move |u, v| {
        let row = (v * ROWS).floor() as i32;
        let (upper, upper_id) = scale(u, v, row);
        let margin = RADIUS - length(upper);
        // Outside the overlapping scale the next row is visible.
        let (offset, id) = if margin > 0.0 { (upper, upper_id) } else { scale(u, v, row + 1) };
        let face = shade(pick(&palette, cell_noise.at_node(id[0], id[1])), 0.95 - 1.6 * offset[1]);
        glazed(face, grout, 0.007, margin.abs())
    })
}

/// Portuguese tiles with blue rosettes, each formed by the corners of four tiles.
pub(crate) fn azulejo() -> TextureFn {
    const N: f32 = 2.0;
    let glaze = Fbm::new(460, [6, 6], 3, 0.5);
    let [white, blue, sky, ochre, grout] = hex([0xEFEDE6, 0x23489B, 0x7FA6D6, 0xD9A441, 0xB8B3A8]);
    Box::new(move |u, v| {
        // Eight-fold symmetry about the centre and the corners of each tile.
        let (x, y) = (0.5 - distance_to_integer(u * N), 0.5 - distance_to_integer(v * N));
        let (a, b) = (x.max(y), x.min(y));
        let from_corner = length([0.5 - x, 0.5 - y]);
        let petal = length([a - 0.17, b]) < 0.10 || length([x - 0.17, y - 0.17]) < 0.075;
        let paint = if x + y < 0.09 || (0.12..0.17).contains(&from_corner) {
            ochre
        } else if petal || from_corner < 0.09 || (0.31..0.36).contains(&from_corner) {
            blue
        } else if from_corner < 0.31 {
            sky
        } else {
            white
        };
        let to_edge = distance_to_integer(u * N).min(distance_to_integer(v * N)) / N;
        glazed(shade(paint, 0.8 + 0.4 * glaze.at(u, v)), grout, 0.005, to_edge)
    })
}
