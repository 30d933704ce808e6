//! Woven and knitted fabrics, felt and leather.

use crate::texture::colour::{Rgb, TextureFn, hex, mix, pick, ramp, shade};
use crate::texture::noise::{Fbm, Noise};
use crate::texture::shaping::{distance_to_integer, fract, parabola, smooth_step};
use crate::texture::voronoi::VoronoiCells;

/// The visible thread at a point of a weave with equally many warp threads (along v) and weft threads (along
/// u).
struct Thread {
    warp: bool,
    number: i32,
    /// Shading of the round thread, 1 along its centre line.
    light: f32,
}

/// Returns the visible thread; `over(warp, weft)` returns `true` where the warp thread passes over the weft
/// thread.
fn thread(u: f32, v: f32, n: i32, over: impl Fn(i32, i32) -> bool) -> Thread {
    let (x, y) = (u * n as f32, v * n as f32);
    let (col, row) = (x.floor() as i32, y.floor() as i32);
    let warp = over(col, row);
    let (number, across) = if warp { (col, x) } else { (row, y) };
    Thread { warp, number, light: 0.6 + 0.4 * parabola(fract(across)) }
}

/// Returns a twill: the warp passes over `over` of every `of` wefts, shifted by one in each row.
fn twill(over: i32, of: i32) -> impl Fn(i32, i32) -> bool {
    move |col, row| (col + row).rem_euclid(of) < over
}

/// Plain weave of uneven flax threads.
pub(crate) fn linen() -> TextureFn {
    const N: i32 = 36;
    let (slubs, wefts) = (Noise::new(1000, [N, 5]), Noise::new(1001, [5, N]));
    let [light, dark] = hex([0xD9CBB0, 0x9C8A6A]);
    Box::new(move |u, v| {
        let thread = thread(u, v, N, twill(1, 2));
        let slub = if thread.warp { slubs.at(u, v) } else { wefts.at(u, v) };
        shade(mix(dark, light, slub), thread.light * if thread.warp { 1.0 } else { 0.85 })
    })
}

/// Twill of indigo warp and white weft, faded in places.
pub(crate) fn denim() -> TextureFn {
    const N: i32 = 48;
    let (fade, yarn) = (Fbm::new(1010, [4, 3], 3, 0.5), Noise::new(1014, [N, 6]));
    let [indigo, worn, white] = hex([0x1F3A63, 0x5C7FAE, 0xB4C0CF]);
    Box::new(move |u, v| {
        let thread = thread(u, v, N, twill(2, 3));
        let faded = smooth_step(0.3, 0.75, fade.at(u, v));
        let colour = if thread.warp {
            mix(indigo, worn, 0.6 * faded + 0.4 * yarn.at(u, v))
        } else {
            shade(white, 0.7)
        };
        shade(colour, thread.light)
    })
}

/// Wool herringbone twill with flecks.
pub(crate) fn tweed() -> TextureFn {
    const N: i32 = 48;
    let (flecks, yarn) = (Noise::new(1020, [N, N]), Fbm::new(1021, [24, 24], 2, 0.6));
    let [brown, cream, fleck] = hex([0x4B3A2D, 0xCDBFA6, 0xB4552D]);
    let slanted = twill(2, 4);
    Box::new(move |u, v| {
        let thread = thread(u, v, N, |col, row| {
            let turned = col.div_euclid(8) & 1 == 1;
            slanted(if turned { -1 - col } else { col }, row)
        });
        let speck = flecks.at_node((u * N as f32) as i32 / 2, (v * N as f32) as i32 / 2) > 0.95;
        let colour = if speck {
            fleck
        } else if thread.warp {
            brown
        } else {
            cream
        };
        shade(colour, thread.light * (0.7 + 0.6 * yarn.at(u, v)))
    })
}

/// A Scottish sett with the same coloured bands in warp and weft.
pub(crate) fn tartan() -> TextureFn {
    const N: i32 = 64;
    let [red, green, navy, yellow, white] = hex([0xA91E22, 0x1E5B34, 0x182848, 0xE0B63A, 0xE6E1D6]);
    // The second half of the sett mirrors the first.
    let band = move |number: i32| match number.min(N - 1 - number) {
        0..2 => white,
        2..10 | 24..30 => red,
        10..17 => green,
        17..22 => navy,
        22..24 => yellow,
        _ => green,
    };
    Box::new(move |u, v| {
        let thread = thread(u, v, N, twill(2, 4));
        shade(band(thread.number), 0.3 + 0.7 * thread.light)
    })
}

/// Matted fibres of one colour.
pub(crate) fn felt() -> TextureFn {
    let (fibres, crossing, cloud) =
        (Fbm::new(1030, [24, 64], 2, 0.7), Fbm::new(1034, [64, 24], 2, 0.7), Fbm::new(1038, [4, 4], 3, 0.5));
    let [dark, light] = hex([0x5E2452, 0xB65AA0]);
    Box::new(move |u, v| {
        let fibre = 0.5 * (fibres.at(u, v) + crossing.at(u, v));
        mix(dark, light, smooth_step(0.15, 0.85, 0.7 * fibre + 0.3 * cloud.at(u, v)))
    })
}

/// Stockinette stitch: columns of Vs, with bands of other colours.
pub(crate) fn knit() -> TextureFn {
    const COLS: f32 = 14.0;
    const ROWS: i32 = 16;
    let fluff = Fbm::new(1040, [48, 48], 2, 0.7);
    let [mustard, cream, brick] = hex([0xD29A2E, 0xEFE3C6, 0xA8452E]);
    Box::new(move |u, v| {
        let leg = 2.0 * distance_to_integer(u * COLS);
        let slanted = v * ROWS as f32 - 0.8 * leg;
        let row = (slanted.floor() as i32).rem_euclid(ROWS);
        let wool = match row {
            2 | 6 => cream,
            3..6 => brick,
            _ => mustard,
        };
        let round = (parabola(leg) * parabola(fract(slanted))).sqrt();
        shade(wool, (0.22 + 0.78 * round) * (0.7 + 0.6 * fluff.at(u, v)))
    })
}

/// Velvet ribs along v.
pub(crate) fn corduroy() -> TextureFn {
    let (pile, cloud) = (Fbm::new(1050, [40, 20], 2, 0.7), Fbm::new(1054, [3, 3], 3, 0.5));
    let palette = hex([0x2C1710, 0x6E3B22, 0x9A5C35, 0xB5794D]);
    Box::new(move |u, v| {
        let rib = parabola(fract(u * 14.0)).sqrt();
        ramp(&palette, 1.2 * rib * (0.4 + 0.7 * pile.at(u, v)) - 0.15 + 0.35 * (cloud.at(u, v) - 0.5))
    })
}

/// Hide with creases between small irregular pads.
pub(crate) fn leather() -> TextureFn {
    let (pads, cloud) = (VoronoiCells::new(1060, [22, 24], 0.9), Fbm::new(1064, [4, 4], 4, 0.5));
    let palette: [Rgb; 3] = hex([0x5A2E1A, 0x6B3820, 0x7A4328]);
    let crease = hex([0x24120A])[0];
    Box::new(move |u, v| {
        let pad = pads.at(u, v);
        let [x, y] = pad.offset;
        let face = shade(pick(&palette, pad.random), 0.6 + 0.8 * cloud.at(u, v) - 6.0 * (x + y));
        mix(crease, face, smooth_step(0.001, 0.010, pad.border_distance()))
    })
}
