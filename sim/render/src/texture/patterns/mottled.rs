//! Mottled surfaces: spots, clouds, animal fur and coats of paint.

use crate::texture::colour::{TextureFn, hex, mix, pick, shade};
use crate::texture::noise::{Fbm, Noise, Warp};
use crate::texture::shaping::{fract, length, smooth_step};
use crate::texture::voronoi::VoronoiCells;

/// Soft blotches and grain.
pub(crate) fn plaster() -> TextureFn {
    let relief = Fbm::new(8, [5, 5], 5, 0.75);
    Box::new(move |u, v| {
        let tone = 0.86 + 0.42 * (relief.at(u, v) - 0.5);
        [tone, tone * 0.995, tone * 0.985]
    })
}

/// Cumulus clouds on a blue sky.
pub(crate) fn clouds() -> TextureFn {
    let (warp, puffs) = (Warp::new(1300, 4, 2, 0.15), Fbm::new(1340, [3, 3], 6, 0.55));
    let [sky, cloud] = hex([0x5E96CF, 0xF6F8FA]);
    Box::new(move |u, v| {
        let (x, y) = warp.at(u, v);
        mix(sky, cloud, smooth_step(0.38, 0.68, puffs.at(x, y)))
    })
}

/// A bird's egg with spots of various sizes.
pub(crate) fn speckle() -> TextureFn {
    let (large, small, cloud) = (
        VoronoiCells::new(1350, [14, 14], 1.0),
        VoronoiCells::new(1354, [32, 32], 1.0),
        Fbm::new(1358, [4, 4], 3, 0.5),
    );
    let [shell, brown] = hex([0xB9D3CC, 0x54402F]);
    Box::new(move |u, v| {
        let ground = shade(shell, 0.75 + 0.5 * cloud.at(u, v));
        let spot = [(&large, 0.022), (&small, 0.010)].iter().any(|(spots, largest)| {
            let spot = spots.at(u, v);
            length(spot.offset) < largest * (1.8 * spot.random - 0.8)
        });
        if spot { brown } else { ground }
    })
}

/// Layered patches of woodland colours.
pub(crate) fn camouflage() -> TextureFn {
    let warp = Warp::new(1360, 6, 2, 0.12);
    let layers = [1420, 1424, 1428].map(|seed| Fbm::new(seed, [5, 5], 2, 0.4));
    let [ground, over @ ..] = hex([0x8A8458, 0x4F5A35, 0x5A4630, 0x22241D]);
    Box::new(move |u, v| {
        let (x, y) = warp.at(u, v);
        // The top layer is the rarest.
        let top = (0..layers.len()).rev().find(|i| layers[*i].at(x, y) > 0.52 + 0.045 * *i as f32);
        top.map_or(ground, |i| over[i])
    })
}

/// Panes of coloured glass in lead cames.
pub(crate) fn stained_glass() -> TextureFn {
    let (panes, cloud) = (VoronoiCells::new(1500, [6, 6], 0.9), Fbm::new(1504, [6, 6], 3, 0.5));
    let palette = hex([0xC8102E, 0x1D4E9E, 0xF2B632, 0x1F8A5B, 0x7A3E9D, 0xE8752C, 0x4FB5D6]);
    let lead = hex([0x17161A])[0];
    Box::new(move |u, v| {
        let pane = panes.at(u, v);
        let light = 0.6 + 0.8 * cloud.at(u, v);
        if pane.border_distance() < 0.009 { lead } else { shade(pick(&palette, pane.random), light) }
    })
}

/// Broken rings on tawny fur.
pub(crate) fn leopard() -> TextureFn {
    let (spots, tear, warp) =
        (VoronoiCells::new(1510, [6, 8], 0.7), Noise::new(1514, [22, 22]), Warp::new(1520, 10, 2, 0.05));
    let [fur, heart, ring] = hex([0xD9A75E, 0xA8702F, 0x2A1B12]);
    Box::new(move |u, v| {
        let (x, y) = warp.at(u, v);
        let spot = spots.at(x, y);
        let radius = length(spot.offset) / (0.045 + 0.02 * spot.random);
        let torn = tear.at(u, v) > 0.62;
        match radius {
            0.0..0.55 => heart,
            0.55..1.0 if !torn => ring,
            _ => fur,
        }
    })
}

/// Stripes that fork and end.
pub(crate) fn zebra() -> TextureFn {
    let (bend, fork) = (Noise::new(1530, [3, 3]), Fbm::new(1531, [6, 4], 2, 0.4));
    let [black, white] = hex([0x1C1A19, 0xF1ECE2]);
    Box::new(move |u, v| {
        let phase = 6.0 * u + 1.5 * bend.at(u, v) + 1.1 * fork.at(u, v);
        if fract(phase) < 0.5 { black } else { white }
    })
}

/// Compressed bark granules.
pub(crate) fn cork() -> TextureFn {
    let (granules, cracks) = (VoronoiCells::new(1540, [22, 22], 1.0), Fbm::new(1544, [24, 24], 3, 0.7));
    let palette = hex([0xC69A63, 0xB58650, 0xD4AE7A, 0x9C6E3E]);
    let bark = hex([0x4A2E19])[0];
    Box::new(move |u, v| {
        let granule = granules.at(u, v);
        let face = shade(pick(&palette, granule.random), 0.7 + 0.6 * cracks.at(u, v));
        mix(face, bark, smooth_step(0.60, 0.72, cracks.at(v, u)))
    })
}

/// One colour with the stipple of a paint roller.
pub(crate) fn roller_paint() -> TextureFn {
    let (skin, cloud) = (Fbm::new(1550, [40, 40], 2, 0.6), Fbm::new(1554, [3, 3], 3, 0.5));
    let paint = hex([0xC9793F])[0];
    Box::new(move |u, v| shade(paint, 0.65 + 0.5 * skin.at(u, v) + 0.2 * cloud.at(u, v)))
}

/// Worn mint paint over an older coat and wood.
pub(crate) fn chipped_paint() -> TextureFn {
    let (warp, wear, skin) =
        (Warp::new(1560, 8, 3, 0.12), Fbm::new(1600, [5, 5], 4, 0.6), Fbm::new(1606, [16, 48], 2, 0.6));
    let [paint, rim, wood] = hex([0x8FC3AE, 0xE9E4D3, 0x6B4A33]);
    Box::new(move |u, v| {
        let (x, y) = warp.at(u, v);
        let light = 0.75 + 0.5 * skin.at(u, v);
        match wear.at(x, y) {
            0.0..0.57 => shade(paint, 0.3 + 0.7 * light),
            0.57..0.60 => rim,
            _ => shade(wood, light),
        }
    })
}
