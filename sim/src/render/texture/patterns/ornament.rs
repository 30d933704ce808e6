//! Figures repeated over a ground.

use super::Shade;
use crate::render::math::trig::on_circle;
use crate::render::texture::colour::{hex, lit, pick};
use crate::render::texture::noise::Noise;
use crate::render::texture::shaping::{bulge, edge, length, odd, wrap};
use crate::render::texture::voronoi::Cells;

/// Distance of a point from a star's middle, 1 at its outline: `N` points, inner corners at `inner` of the outer.
fn star_distance<const N: usize>([x, y]: [f32; 2], inner: f32) -> f32 {
    // The star is the union of N kites; the one whose axis is nearest decides.
    let (mut along, mut across) = (f32::NEG_INFINITY, 0.0);
    for i in 0..N {
        // Turned so that one point looks up, which is −v.
        let (cos, sin) = on_circle(4 * i + 3 * N, 4 * N);
        let way = x * cos + y * sin;
        if way > along {
            (along, across) = (way, (y * cos - x * sin).abs());
        }
    }
    // The side runs from the outer point (1, 0) to the inner corner.
    let (cos, sin) = on_circle(1, 2 * N);
    along + across * (1.0 - inner * cos) / (inner * sin)
}

/// Gold stars on a dark sky.
pub(super) fn stars() -> Shade {
    let places = Cells::new(1200, [4, 4], 0.0);
    let [sky, gold, silver] = hex([0x1B2350, 0xF2C14E, 0xDDE3F0]);
    Box::new(move |u, v| {
        let place = places.at(u, v);
        let star = if place.id[1] & 1 == 0 { gold } else { silver };
        if star_distance::<5>(place.offset, 0.42) < 0.105 { star } else { sky }
    })
}

/// Blossoms of six petals with a yellow heart.
pub(super) fn flowers() -> Shade {
    let places = Cells::new(1210, [4, 4], 0.35);
    let petals = hex([0xE86A92, 0xF7E1D7, 0xC05299, 0xF4A259]);
    let [meadow, heart] = hex([0x5B8E55, 0xF6D743]);
    Box::new(move |u, v| {
        let place = places.at(u, v);
        let radius = length(place.offset);
        let petal = (0..6).any(|i| {
            let (cos, sin) = on_circle(i, 6);
            length([place.offset[0] - 0.055 * cos, place.offset[1] - 0.055 * sin]) < 0.031
        });
        match radius {
            0.0..0.026 => heart,
            _ if petal => pick(&petals, place.lot),
            _ => meadow,
        }
    })
}

/// Lozenges of two colours, crossed by thin lines.
pub(super) fn argyle() -> Shade {
    let [plum, grey, sand, line] = hex([0x6A2E4F, 0x8A8D91, 0xD9C7A3, 0xF5F0E6]);
    Box::new(move |u, v| {
        let (x, y) = (4.0 * u + 2.0 * v, 4.0 * u - 2.0 * v);
        if edge(x + 0.5).min(edge(y + 0.5)) < 0.025 {
            return line;
        }
        match (odd(x, 0.0), odd(y, 0.0)) {
            (true, true) => plum,
            (false, false) => grey,
            _ => sand,
        }
    })
}

/// Triangles, each its own colour.
pub(super) fn triangles() -> Shade {
    const N: i32 = 6;
    let lots = Noise::new(1222, [2 * N, N]);
    let palette = hex([0x264653, 0x2A9D8F, 0xE9C46A, 0xF4A261, 0xE76F51, 0xF1E8DC]);
    Box::new(move |u, v| {
        let y = v * N as f32;
        // Odd rows stand half a triangle further, and in each the lines lean both ways.
        let x = u * N as f32 + 0.5 * y.floor();
        let lower = wrap(y) > 1.0 - 2.0 * edge(x);
        let col = if lower { 2 * x.floor() as i32 } else { 2 * (x + 0.5).floor() as i32 + 1 };
        pick(&palette, lots.at_node(col, y as i32))
    })
}

/// Cubes seen along their diagonals, piled up.
pub(super) fn cubes() -> Shade {
    let places = Cells::new(1230, [5, 6], 0.0);
    let faces = hex([0xE6D3A8, 0xA8573B, 0x5A2B2A]);
    Box::new(move |u, v| {
        let [x, y] = places.at(u, v).offset;
        // The three faces meet in the middle. The upper one reaches from there to the hexagon's upper side corners,
        // which for this many columns and rows lie in directions of slope 8/15.
        if y < -x.abs() * (8.0 / 15.0) {
            faces[0]
        } else if x < 0.0 {
            faces[1]
        } else {
            faces[2]
        }
    })
}

/// Ribbons woven over and under, dark gaps between.
pub(super) fn lattice() -> Shade {
    const N: f32 = 6.0;
    let [teal, amber, gap] = hex([0x3F8C88, 0xD8A24A, 0x2A211B]);
    Box::new(move |u, v| {
        let (x, y) = (N * u, N * v);
        let covers = |t: f32| edge(t) > 0.14;
        let (colour, across) = match (covers(x), covers(y)) {
            (false, false) => return gap,
            (true, false) => (teal, x),
            (false, true) => (amber, y),
            (true, true) => {
                if odd(x, y) {
                    (teal, x)
                } else {
                    (amber, y)
                }
            }
        };
        lit(colour, 0.4 + 0.6 * bulge(wrap(across)))
    })
}
