//! Figures repeated over a plain background.

use crate::math::trig::on_circle;
use crate::texture::colour::{TextureFn, hex, pick, shade};
use crate::texture::noise::Noise;
use crate::texture::shaping::{distance_to_integer, fract, is_odd_square, length, parabola};
use crate::texture::voronoi::VoronoiCells;

/// Returns the distance from the centre of an `N`-pointed star in units of its outline (1 on the outline).
/// The inner corners lie at `inner` times the radius of the outer ones.
fn star_distance<const N: usize>([x, y]: [f32; 2], inner: f32) -> f32 {
    // The star is a union of N kites. The kite with the closest axis decides.
    let (mut along, mut across) = (f32::NEG_INFINITY, 0.0);
    for i in 0..N {
        // Rotated so that one point is up, along −v.
        let (cos, sin) = on_circle(4 * i + 3 * N, 4 * N);
        let projection = x * cos + y * sin;
        if projection > along {
            (along, across) = (projection, (y * cos - x * sin).abs());
        }
    }
    // The edge runs from the outer corner (1, 0) to the inner corner.
    let (cos, sin) = on_circle(1, 2 * N);
    along + across * (1.0 - inner * cos) / (inner * sin)
}

/// Gold stars on a dark sky.
pub(crate) fn stars() -> TextureFn {
    let places = VoronoiCells::new(1200, [4, 4], 0.0);
    let [sky, gold, silver] = hex([0x1B2350, 0xF2C14E, 0xDDE3F0]);
    Box::new(move |u, v| {
        let place = places.at(u, v);
        let star = if place.id[1] & 1 == 0 { gold } else { silver };
        if star_distance::<5>(place.offset, 0.42) < 0.105 { star } else { sky }
    })
}

/// Flowers with six petals and a yellow centre.
pub(crate) fn flowers() -> TextureFn {
    let places = VoronoiCells::new(1210, [4, 4], 0.35);
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
            _ if petal => pick(&petals, place.random),
            _ => meadow,
        }
    })
}

/// Lozenges of two colours, crossed by thin lines.
pub(crate) fn argyle() -> TextureFn {
    let [plum, grey, sand, line] = hex([0x6A2E4F, 0x8A8D91, 0xD9C7A3, 0xF5F0E6]);
    Box::new(move |u, v| {
        let (x, y) = (4.0 * u + 2.0 * v, 4.0 * u - 2.0 * v);
        if distance_to_integer(x + 0.5).min(distance_to_integer(y + 0.5)) < 0.025 {
            return line;
        }
        match (is_odd_square(x, 0.0), is_odd_square(y, 0.0)) {
            (true, true) => plum,
            (false, false) => grey,
            _ => sand,
        }
    })
}

/// Triangles in random colours.
pub(crate) fn triangles() -> TextureFn {
    const N: i32 = 6;
    let cell_noise = Noise::new(1222, [2 * N, N]);
    let palette = hex([0x264653, 0x2A9D8F, 0xE9C46A, 0xF4A261, 0xE76F51, 0xF1E8DC]);
    Box::new(move |u, v| {
        let y = v * N as f32;
        // Each row is shifted by half a triangle against the one above.
        let x = u * N as f32 + 0.5 * y.floor();
        let lower = fract(y) > 1.0 - 2.0 * distance_to_integer(x);
        let col = if lower { 2 * x.floor() as i32 } else { 2 * (x + 0.5).floor() as i32 + 1 };
        pick(&palette, cell_noise.at_node(col, y as i32))
    })
}

/// Stacked cubes in isometric projection.
pub(crate) fn cubes() -> TextureFn {
    let places = VoronoiCells::new(1230, [5, 6], 0.0);
    let faces = hex([0xE6D3A8, 0xA8573B, 0x5A2B2A]);
    Box::new(move |u, v| {
        let [x, y] = places.at(u, v).offset;
        // The three faces meet at the centre. The upper one extends to the upper side corners of the hexagon,
        // which lie in directions of slope 8/15 for this number of columns and rows.
        if y < -x.abs() * (8.0 / 15.0) {
            faces[0]
        } else if x < 0.0 {
            faces[1]
        } else {
            faces[2]
        }
    })
}

/// Woven ribbons with dark gaps.
pub(crate) fn lattice() -> TextureFn {
    const N: f32 = 6.0;
    let [teal, amber, gap] = hex([0x3F8C88, 0xD8A24A, 0x2A211B]);
    Box::new(move |u, v| {
        let (x, y) = (N * u, N * v);
        let covers = |t: f32| distance_to_integer(t) > 0.14;
        let (colour, across) = match (covers(x), covers(y)) {
            (false, false) => return gap,
            (true, false) => (teal, x),
            (false, true) => (amber, y),
            (true, true) => {
                if is_odd_square(x, y) {
                    (teal, x)
                } else {
                    (amber, y)
                }
            }
        };
        shade(colour, 0.4 + 0.6 * parabola(fract(across)))
    })
}
