//! Polished, split and laid stone.

use crate::texture::colour::{TextureFn, hex, mix, pick, shade};
use crate::texture::layout;
use crate::texture::noise::{Fbm, Noise, Warp};
use crate::texture::shaping::{fract, smooth_step};
use crate::texture::voronoi::VoronoiCells;

/// Polished stone: clouds, broad soft veins and fine sharp veins. Both kinds of veins share one domain warp.
struct Veined {
    warp: Warp,
    clouds: Fbm,
    broad: Noise,
    fine: Noise,
}

impl Veined {
    fn new(seed: u64) -> Self {
        Self {
            warp: Warp::new(seed, 3, 3, 0.30),
            clouds: Fbm::new(seed + 40, [4, 4], 4, 0.55),
            broad: Noise::new(seed + 50, [3, 3]),
            fine: Noise::new(seed + 51, [5, 5]),
        }
    }

    /// Returns the strengths in [0, 1] of cloud, broad vein and fine vein.
    fn at(&self, u: f32, v: f32) -> [f32; 3] {
        let (x, y) = self.warp.at(u, v);
        // Veins follow the level set of the noise at 1/2.
        let vein = |noise: &Noise, width| 1.0 - smooth_step(0.0, width, (noise.at(x, y) - 0.5).abs());
        [smooth_step(0.3, 0.7, self.clouds.at(u, v)), vein(&self.broad, 0.10), vein(&self.fine, 0.045)]
    }
}

/// White with grey veins.
pub(crate) fn marble() -> TextureFn {
    let veined = Veined::new(500);
    let [white, grey, vein] = hex([0xF4F2EE, 0xD4D3D2, 0x75787D]);
    Box::new(move |u, v| {
        let [cloud, broad, fine] = veined.at(u, v);
        mix(mix(mix(white, grey, cloud), vein, 0.7 * broad * cloud), vein, 0.55 * fine)
    })
}

/// Dark green with pale veins.
pub(crate) fn green_marble() -> TextureFn {
    let veined = Veined::new(630);
    let [dark, green, pale] = hex([0x12301F, 0x2F6B4A, 0xB9D2BE]);
    Box::new(move |u, v| {
        let [cloud, broad, fine] = veined.at(u, v);
        mix(mix(mix(dark, green, cloud), green, 0.6 * broad), pale, 0.8 * fine)
    })
}

/// Crystals in the colours of several minerals.
pub(crate) fn granite() -> TextureFn {
    let (crystals, drift) = (VoronoiCells::new(760, [44, 44], 1.0), Noise::new(764, [7, 7]));
    let palette = hex([0x2B2727, 0x8C7A74, 0xB98F80, 0xC9A99B, 0xD9CFC6]);
    Box::new(move |u, v| {
        let crystal = crystals.at(u, v);
        let random = 0.75 * crystal.random + 0.25 * drift.at(u, v);
        shade(pick(&palette, random.min(0.999)), 0.85 + 0.3 * fract(13.0 * crystal.random))
    })
}

/// Rows of overlapping split shingles.
pub(crate) fn slate() -> TextureFn {
    let (cell_noise, cleft, warp) =
        (Noise::new(770, [4, 6]), Fbm::new(771, [6, 18], 4, 0.65), Warp::new(776, 12, 2, 0.02));
    let palette = hex([0x454E59, 0x535B63, 0x3A434D, 0x5A5C66, 0x4B4A55]);
    Box::new(move |u, v| {
        let (x, y) = warp.at(u, v);
        let block = layout::courses(x, y, [4, 6], 0.5);
        // The row above casts a shadow on the upper end of a shingle.
        let shadow = smooth_step(0.0, 0.022, block.across);
        let gap = smooth_step(0.002, 0.008, block.edge_distance);
        let random = cell_noise.at_node(block.id[0], block.id[1]);
        // The steps of the cleft surface catch the light.
        let layer = 9.0 * cleft.at(u + random, v);
        let step = 0.72 + 0.5 * fract(layer) * (1.0 - smooth_step(0.8, 1.0, fract(layer)));
        shade(pick(&palette, random), step * (0.35 + 0.65 * shadow) * (0.3 + 0.7 * gap))
    })
}

/// Chips of coloured stone in pale cement.
pub(crate) fn terrazzo() -> TextureFn {
    let chips = VoronoiCells::new(780, [14, 14], 1.0);
    let palette = hex([0xC4694C, 0x3E5A63, 0xD9A95B, 0x8B8078, 0xE2B7A2, 0x5E7F6B]);
    let cement = hex([0xE9E3D7])[0];
    Box::new(move |u, v| {
        let chip = chips.at(u, v);
        // A chip is a Voronoi cell shrunk by a random border.
        let share = fract(17.0 * chip.random);
        let border = 0.004 + 0.020 * share * share;
        if chip.border_distance() > border { pick(&palette, chip.random) } else { cement }
    })
}

/// Rounded setts with earth in the gaps.
pub(crate) fn cobble() -> TextureFn {
    let (setts, rough) = (VoronoiCells::new(790, [6, 8], 0.55), Fbm::new(794, [20, 20], 3, 0.7));
    let palette = hex([0x8E8778, 0xA39A88, 0x77736B, 0x9C8B75, 0x6A6661]);
    let earth = hex([0x2E2923])[0];
    Box::new(move |u, v| {
        let sett = setts.at(u, v);
        let [x, y] = sett.offset;
        let dome = smooth_step(0.004, 0.05, sett.border_distance());
        let light = (0.35 + 0.65 * dome - 1.8 * (x + y)) * (0.65 + 0.7 * rough.at(u, v));
        mix(
            earth,
            shade(pick(&palette, sett.random), light),
            smooth_step(0.005, 0.014, sett.border_distance()),
        )
    })
}

/// Layers of sand.
pub(crate) fn sandstone() -> TextureFn {
    let (warp, layers, grain) =
        (Noise::new(800, [4, 3]), Fbm::new(804, [1, 20], 2, 0.7), Fbm::new(808, [64, 64], 2, 0.8));
    let palette = hex([0xA8806C, 0xC9A183, 0xDDBF9A, 0xB48C7C, 0xE6D3B4, 0xC7A99A]);
    Box::new(move |u, v| {
        let age = layers.at(u, v + 0.06 * warp.at(u, v));
        shade(pick(&palette, (1.6 * age - 0.3).clamp(0.0, 0.99)), 0.65 + 0.7 * grain.at(u, v))
    })
}
