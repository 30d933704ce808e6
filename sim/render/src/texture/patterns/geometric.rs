//! Geometric patterns of lines and areas.

use crate::texture::colour::{TextureFn, hex, mix, pick, shade};
use crate::texture::noise::Noise;
use crate::texture::shaping::{distance_to_integer, fract, length, smooth_wave};
use crate::texture::voronoi::VoronoiCells;

/// A grey floor with a thin white line, 1/64 of the tile wide, along two edges of the tile.
pub(crate) fn floor_grid() -> TextureFn {
    const LINE: f32 = 1.0 - 1.0 / 64.0;
    let [floor, line] = hex([0x777B84, 0xAFB4C0]);
    Box::new(move |u, v| if u >= LINE || v >= LINE { line } else { floor })
}

/// Awning stripes along v.
pub(crate) fn stripes() -> TextureFn {
    let [navy, cream, red] = hex([0x1F3B63, 0xF2E8D5, 0xC8402F]);
    Box::new(move |u, _| match fract(4.0 * u) {
        0.0..0.4 => navy,
        0.6..0.8 => red,
        _ => cream,
    })
}

/// Two sets of translucent stripes that cross at right angles.
pub(crate) fn gingham() -> TextureFn {
    let palette = hex([0xFAFAF5, 0x86B79A, 0x2F7D55]);
    Box::new(move |u, v| palette[[u, v].iter().filter(|t| fract(4.0 * **t) < 0.5).count()])
}

/// Dots in staggered rows.
pub(crate) fn polka_dots() -> TextureFn {
    let dots = VoronoiCells::new(1100, [5, 6], 0.0);
    let [ground, dot] = hex([0xD9486E, 0xFFF4EC]);
    Box::new(move |u, v| if length(dots.at(u, v).offset) < 0.052 { dot } else { ground })
}

/// Broad zigzag bands.
pub(crate) fn chevrons() -> TextureFn {
    let palette = hex([0xF4D35E, 0x33658A, 0xF6F1E3, 0x55828B]);
    Box::new(move |u, v| pick(&palette, fract(2.0 * v + 2.0 * distance_to_integer(2.0 * u))))
}

/// Narrow zigzag lines.
pub(crate) fn zigzags() -> TextureFn {
    let [ground, line] = hex([0x2A2A32, 0x8BD0B4]);
    Box::new(
        move |u, v| if fract(7.0 * v + 1.8 * distance_to_integer(6.0 * u)) < 0.36 { line } else { ground },
    )
}

/// Concentric circles in six colours.
pub(crate) fn rings() -> TextureFn {
    let palette = hex([0xE4572E, 0xF3E9D2, 0x17BEBB, 0xF3E9D2, 0x2E282A, 0xF3E9D2]);
    Box::new(move |u, v| {
        let radius = 2.0 * length([0.5 - distance_to_integer(2.0 * u), 0.5 - distance_to_integer(2.0 * v)]);
        palette[((1.39 - radius) * 5.0) as usize % palette.len()]
    })
}

/// Twill of four dark and four light threads in both directions.
pub(crate) fn houndstooth() -> TextureFn {
    let [dark, light] = hex([0x23201F, 0xEDE7DB]);
    Box::new(move |u, v| {
        let (col, row) = ((32.0 * u) as i32, (32.0 * v) as i32);
        let thread = if (col + row) & 3 < 2 { col } else { row };
        if thread & 7 < 4 { dark } else { light }
    })
}

/// A maze of walls along one of the two diagonals of each square.
pub(crate) fn maze() -> TextureFn {
    const N: i32 = 10;
    let cell_noise = Noise::new(1110, [N, N]);
    let [ground, wall] = hex([0x35508F, 0xB9C8EE]);
    Box::new(move |u, v| {
        let (x, y) = (u * N as f32, v * N as f32);
        let (fx, fy) = (fract(x), fract(y));
        let rising = cell_noise.at_node(x as i32, y as i32) < 0.5;
        // The other two corners are filled too, because walls of neighbouring squares may end there.
        let from_wall = if rising { distance_to_integer(fx - fy) } else { distance_to_integer(fx + fy) };
        if from_wall < 0.18 { wall } else { ground }
    })
}

/// Truchet tiles: quarter circles around two opposite corners of each square (Truchet, 1704; Smith, 1987).
pub(crate) fn arcs() -> TextureFn {
    const N: i32 = 8;
    let cell_noise = Noise::new(1120, [N, N]);
    let [ground, line, rim] = hex([0xF0D9B5, 0xB5483A, 0x6B2A2A]);
    Box::new(move |u, v| {
        let (x, y) = (u * N as f32, v * N as f32);
        let fx = if cell_noise.at_node(x as i32, y as i32) < 0.5 { fract(x) } else { 1.0 - fract(x) };
        let fy = fract(y);
        let from_line = [[fx, fy], [1.0 - fx, 1.0 - fy]].map(|offset| (length(offset) - 0.5).abs());
        match from_line[0].min(from_line[1]) {
            0.0..0.10 => line,
            0.10..0.18 => rim,
            _ => ground,
        }
    })
}

/// Rows of waves in bands of blue.
pub(crate) fn waves() -> TextureFn {
    let palette = hex([0xEAF3F3, 0x9CC9D6, 0x3F8FB0, 0x1F5F8B, 0x16405F]);
    Box::new(move |u, v| {
        let height = 3.0 * v + 0.28 * smooth_wave(3.0 * u);
        let colour = pick(&palette, fract(height));
        // Bands darken towards their lower edges.
        shade(mix(colour, palette[2], 0.1), 1.05 - 0.25 * fract(5.0 * height))
    })
}
