//! Lines and areas ruled over the plane.

use super::Shade;
use crate::render::texture::colour::{hex, lit, mix, pick};
use crate::render::texture::noise::Noise;
use crate::render::texture::shaping::{edge, length, odd, smooth_step, swing, wrap};
use crate::render::texture::voronoi::Cells;

/// Squares of 1 m, light and dark, with a thin line at every edge.
pub(super) fn checker() -> Shade {
    const SQUARES: f32 = 4.0;
    let speckle = Noise::new(5, [128, 128]);
    Box::new(move |u, v| {
        let (x, y) = (u * SQUARES, v * SQUARES);
        let line = 1.0 - smooth_step(0.006, 0.014, edge(x).min(edge(y)));
        let tone = if odd(x, y) { 0.52 } else { 0.88 } + 0.04 * (speckle.at(u, v) - 0.5);
        [tone * (1.0 - 0.5 * line); 3]
    })
}

/// Awning stripes along v.
pub(super) fn stripes() -> Shade {
    let [navy, cream, red] = hex([0x1F3B63, 0xF2E8D5, 0xC8402F]);
    Box::new(move |u, _| match wrap(4.0 * u) {
        0.0..0.4 => navy,
        0.6..0.8 => red,
        _ => cream,
    })
}

/// Two sets of translucent stripes at right angles.
pub(super) fn gingham() -> Shade {
    let palette = hex([0xFAFAF5, 0x86B79A, 0x2F7D55]);
    Box::new(move |u, v| palette[[u, v].iter().filter(|t| wrap(4.0 * **t) < 0.5).count()])
}

/// Dots in staggered rows.
pub(super) fn polka_dots() -> Shade {
    let dots = Cells::new(1100, [5, 6], 0.0);
    let [ground, dot] = hex([0xD9486E, 0xFFF4EC]);
    Box::new(move |u, v| if length(dots.at(u, v).offset) < 0.052 { dot } else { ground })
}

/// Broad bands bent into Vs.
pub(super) fn chevrons() -> Shade {
    let palette = hex([0xF4D35E, 0x33658A, 0xF6F1E3, 0x55828B]);
    Box::new(move |u, v| pick(&palette, wrap(2.0 * v + 2.0 * edge(2.0 * u))))
}

/// Narrow lines that turn often.
pub(super) fn zigzags() -> Shade {
    let [ground, line] = hex([0x2A2A32, 0x8BD0B4]);
    Box::new(move |u, v| if wrap(7.0 * v + 1.8 * edge(6.0 * u)) < 0.36 { line } else { ground })
}

/// Circles within circles.
pub(super) fn rings() -> Shade {
    let palette = hex([0xE4572E, 0xF3E9D2, 0x17BEBB, 0xF3E9D2, 0x2E282A, 0xF3E9D2]);
    Box::new(move |u, v| {
        let radius = 2.0 * length([0.5 - edge(2.0 * u), 0.5 - edge(2.0 * v)]);
        palette[((1.39 - radius) * 5.0) as usize % palette.len()]
    })
}

/// Four dark and four light threads in both directions, woven as twill.
pub(super) fn houndstooth() -> Shade {
    let [dark, light] = hex([0x23201F, 0xEDE7DB]);
    Box::new(move |u, v| {
        let (col, row) = ((32.0 * u) as i32, (32.0 * v) as i32);
        let thread = if (col + row) & 3 < 2 { col } else { row };
        if thread & 7 < 4 { dark } else { light }
    })
}

/// Walls along one diagonal or the other of each square.
pub(super) fn maze() -> Shade {
    const N: i32 = 10;
    let lots = Noise::new(1110, [N, N]);
    let [ground, wall] = hex([0x35508F, 0xB9C8EE]);
    Box::new(move |u, v| {
        let (x, y) = (u * N as f32, v * N as f32);
        let (fx, fy) = (wrap(x), wrap(y));
        let rising = lots.at_node(x as i32, y as i32) < 0.5;
        // The other two corners are filled as well: walls of the neighbouring squares may end there.
        let from_wall = if rising { edge(fx - fy) } else { edge(fx + fy) };
        if from_wall < 0.18 { wall } else { ground }
    })
}

/// Quarter circles around two opposite corners of each square (Truchet, 1704; Smith, 1987).
pub(super) fn arcs() -> Shade {
    const N: i32 = 8;
    let lots = Noise::new(1120, [N, N]);
    let [ground, line, rim] = hex([0xF0D9B5, 0xB5483A, 0x6B2A2A]);
    Box::new(move |u, v| {
        let (x, y) = (u * N as f32, v * N as f32);
        let fx = if lots.at_node(x as i32, y as i32) < 0.5 { wrap(x) } else { 1.0 - wrap(x) };
        let fy = wrap(y);
        let from_line = [[fx, fy], [1.0 - fx, 1.0 - fy]].map(|way| (length(way) - 0.5).abs());
        match from_line[0].min(from_line[1]) {
            0.0..0.10 => line,
            0.10..0.18 => rim,
            _ => ground,
        }
    })
}

/// Swell upon swell.
pub(super) fn waves() -> Shade {
    let palette = hex([0xEAF3F3, 0x9CC9D6, 0x3F8FB0, 0x1F5F8B, 0x16405F]);
    Box::new(move |u, v| {
        let height = 3.0 * v + 0.28 * swing(3.0 * u);
        let colour = pick(&palette, wrap(height));
        // Bands darken towards their lower edges.
        lit(mix(colour, palette[2], 0.1), 1.05 - 0.25 * wrap(5.0 * height))
    })
}
