//! Wood: planks, floors, veneer, end grain and bamboo.

use crate::texture::colour::{Rgb, TextureFn, hex, mix, pick, ramp, shade};
use crate::texture::layout::{self, LayoutRect};
use crate::texture::noise::{Fbm, Noise, Warp};
use crate::texture::shaping::{distance_to_integer, fract, length, parabola, smooth_step, smooth_wave};

/// The figure of a board: growth rings and fibres along its length.
struct Grain {
    warp: Noise,
    fibres: Fbm,
}

impl Grain {
    fn new(seed: u64) -> Self {
        let (long, short) = (Noise::new(seed + 1, [160, 5]), Noise::new(seed + 2, [128, 24]));
        Self { warp: Noise::new(seed, [16, 3]), fibres: Fbm::weighted_sum(&[(long, 0.6), (short, 0.4)]) }
    }

    /// Returns the growth-ring value and the fibre lightness, both in [0, 1], for `n` rings per tile.
    fn at(&self, across: f32, along: f32, n: f32) -> (f32, f32) {
        let ring = ring_wave(across * n + 1.3 * self.warp.at(along, across));
        (ring, self.fibres.at(across, along))
    }

    /// Returns the figure of a strip cut from a random part of the tree, as a light factor around 1.
    fn of_block(&self, block: &LayoutRect, random: f32) -> f32 {
        let (ring, fibre) = self.at(block.across + 3.7 * random, block.along + 2.3 * random, 30.0);
        1.0 + 0.36 * (fibre - 0.5) - 0.18 * ring
    }
}

/// Profile of a growth ring with period 1: a slow rise and a quick fall.
fn ring_wave(t: f32) -> f32 {
    let phase = fract(t);
    smooth_step(0.0, 0.8, phase) - smooth_step(0.85, 1.0, phase)
}

/// Boards along v, each with its own tone, long grain and a fine dark joint.
pub(crate) fn planks() -> TextureFn {
    const BOARDS: i32 = 8;
    let (tone, grain) = (Noise::new(1, [BOARDS, 1]), Grain::new(2));
    Box::new(move |u, v| {
        let across = u * BOARDS as f32;
        let shift = tone.at_node(across as i32, 0);
        let along = fract(v + shift);
        let joint = smooth_step(0.0, 0.035, 0.028 - distance_to_integer(across));
        let end = smooth_step(0.0, 0.004, 0.0035 - distance_to_integer(along));
        let (ring, fibre) = grain.at(u, along, 46.0);
        let light = 0.80 + 0.16 * shift + 0.10 * (fibre - 0.5) - 0.07 * ring;
        let light = light * (1.0 - 0.45 * joint.max(end));
        let warmth = 0.06 * (1.0 - light) + 0.03 * shift;
        [light, light * (0.99 - warmth), light * (0.97 - 2.0 * warmth)]
    })
}

/// A board with many narrow rings along v. Its contrast includes the relief of the benchmark's table, so that
/// neighbouring pixels differ as much as there in each camera.
pub(crate) fn cedar() -> TextureFn {
    let bow = Fbm::new(8, [11, 2], 3, 0.4);
    let (streaks, flecks) = (Noise::new(10, [200, 3]), Noise::new(11, [256, 64]));
    let palette = hex([0xAC6641, 0xD87F4F, 0xF39862]);
    Box::new(move |u, v| {
        let phase = fract(44.0 * u + 3.6 * bow.at(u, v));
        let ring = smooth_step(0.18, 0.42, phase) - smooth_step(0.76, 1.0, phase);
        let fibre = 0.64 * (streaks.at(u, v) - 0.5) + 1.23 * (flecks.at(u, v) - 0.5);
        ramp(&palette, 0.13 + 0.62 * ring + fibre)
    })
}

/// Pale veneer with a faint figure along v and flecks.
pub(crate) fn maple() -> TextureFn {
    let (grain, patches) = (Grain::new(12), Fbm::new(16, [4, 2], 3, 0.5));
    let flecks = Noise::new(19, [256, 192]);
    let palette = hex([0xEDC48A, 0xF9D79D, 0xFFE2AF]);
    Box::new(move |u, v| {
        let (ring, fibre) = grain.at(u, v, 8.0);
        let figure = 0.5 * (fibre - 0.5) + 0.5 * (patches.at(u, v) - 0.5);
        ramp(&palette, 0.34 + 0.08 * ring + figure + 0.6 * (flecks.at(u, v) - 0.5))
    })
}

/// Grey, weathered boards with furrows.
pub(crate) fn barnwood() -> TextureFn {
    const BOARDS: i32 = 5;
    let (cell_noise, furrows, stain) =
        (Noise::new(20, [BOARDS, 1]), Fbm::new(21, [48, 2], 2, 0.7), Fbm::new(25, [4, 3], 3, 0.5));
    let palette = hex([0x3A3029, 0x6E6257, 0x9A8F84, 0xB9AC9E]);
    let gap = hex([0x14100D])[0];
    Box::new(move |u, v| {
        let across = u * BOARDS as f32;
        let random = cell_noise.at_node(across as i32, 0);
        if distance_to_integer(across) < 0.03 {
            return gap;
        }
        let furrow = furrows.at(u + 0.01 * (stain.at(u, v) - 0.5), v + random);
        ramp(&palette, 1.3 * (furrow - 0.5) + 0.35 + 0.4 * random + 0.5 * (stain.at(u, v) - 0.5))
    })
}

/// Squares of short strips, rotated by 90° from square to square.
pub(crate) fn parquet() -> TextureFn {
    let (cell_noise, grain) = (Noise::new(30, [4, 16]), Grain::new(31));
    let palette = hex([0xA66A2E, 0xC08646, 0xD19C5B, 0x8F5724]);
    let joint = hex([0x3B2411])[0];
    Box::new(move |u, v| floor_strip(&layout::basket(u, v, 4, 4), &cell_noise, &grain, &palette, joint))
}

/// Dark herringbone strips at 45°.
pub(crate) fn herringbone_floor() -> TextureFn {
    let (cell_noise, grain) = (Noise::new(40, [16, 16]), Grain::new(41));
    let palette = hex([0x5C3A22, 0x70482B, 0x82573A, 0x4A2D1A]);
    let joint = hex([0x1D110A])[0];
    Box::new(move |u, v| {
        let block = layout::herringbone(u + v, u - v, 16, 4);
        floor_strip(&block, &cell_noise, &grain, &palette, joint)
    })
}

/// Returns the colour of a floor strip with a random colour and figure, including the joint around it.
fn floor_strip(block: &LayoutRect, cell_noise: &Noise, grain: &Grain, palette: &[Rgb], joint: Rgb) -> Rgb {
    let random = cell_noise.at_node(block.id[0], block.id[1]);
    let face = shade(pick(palette, random), grain.of_block(block, random));
    mix(joint, face, smooth_step(0.002, 0.006, block.edge_distance))
}

/// Flat-sawn veneer, whose rings form long arches.
pub(crate) fn walnut() -> TextureFn {
    let (hills, fibres) = (Fbm::new(50, [4, 1], 3, 0.3), Fbm::new(54, [48, 4], 2, 0.6));
    let palette = hex([0x9A6B45, 0x7C5233, 0x5E3B23, 0x3E2515]);
    Box::new(move |u, v| {
        let ring = ring_wave(12.0 * hills.at(u, v));
        ramp(&palette, 0.15 + 0.65 * ring + 0.7 * (fibres.at(u, v) - 0.5))
    })
}

/// End grain of square posts glued together.
pub(crate) fn butcher_block() -> TextureFn {
    const POSTS: i32 = 4;
    let cell_noise = [60, 61, 62].map(|seed| Noise::new(seed, [POSTS, POSTS]));
    let wobble = Fbm::new(63, [8, 8], 3, 0.5);
    let palette = hex([0xE3BD84, 0xCF9F63, 0xB9854B, 0x8B5A33, 0xDDB078]);
    Box::new(move |u, v| {
        let block = layout::courses(u, v, [POSTS, POSTS], 0.5);
        let [random, x, y] = [0, 1, 2].map(|i: usize| cell_noise[i].at_node(block.id[0], block.id[1]));
        // The pith of the tree lies outside the post, beyond one of its sides.
        let pith = [0.7 * (x - 0.5) + 0.125, if y > 0.5 { 0.35 } else { -0.1 }];
        let radius = length([block.along - pith[0], block.across - pith[1]]);
        let ring = ring_wave(radius * 36.0 + 1.2 * wobble.at(u, v));
        let light = (1.0 - 0.30 * ring) * (0.8 + 0.4 * wobble.at(v, u));
        shade(pick(&palette, random), light * (0.45 + 0.55 * smooth_step(0.001, 0.006, block.edge_distance)))
    })
}

/// The edge of a plywood board, whose layers alternate between long and cross grain.
pub(crate) fn plywood() -> TextureFn {
    const LAYERS: i32 = 8;
    let (warp, along, ends) =
        (Warp::new(70, 4, 2, 0.03), Fbm::new(104, [5, 64], 2, 0.6), Fbm::new(108, [48, 32], 2, 0.6));
    let [pale, tan, glue] = hex([0xE9CFA2, 0xB88A58, 0x6B4526]);
    Box::new(move |u, v| {
        let (u, v) = (u, warp.at(u, v).1);
        let layer = v * LAYERS as f32;
        let face = if layer.floor() as i32 & 1 == 0 {
            shade(pale, 0.8 + 0.4 * along.at(u, v))
        } else {
            shade(tan, 0.55 + 0.9 * ends.at(u, v))
        };
        mix(glue, face, smooth_step(0.04, 0.10, distance_to_integer(layer)))
    })
}

/// Parallel canes with knots at random heights.
pub(crate) fn bamboo() -> TextureFn {
    const CANES: i32 = 7;
    let (cell_noise, fibres) = (Noise::new(80, [CANES, 1]), Noise::new(81, [96, 4]));
    let palette = hex([0xC9B45C, 0xB7A24A, 0xD8C878, 0x9DA04A]);
    let knot_colour = hex([0x6A5A26])[0];
    Box::new(move |u, v| {
        let across = u * CANES as f32;
        let random = cell_noise.at_node(across as i32, 0);
        let knot = distance_to_integer(2.0 * (v + random));
        let face = mix(pick(&palette, random), knot_colour, 1.0 - smooth_step(0.012, 0.05, knot));
        let above = smooth_step(0.02, 0.12, fract(2.0 * (v + random)));
        let round = 0.25 + 0.75 * parabola(fract(across)).sqrt();
        let sheen = 0.12 * smooth_wave(fract(across) + 0.15);
        shade(face, round * (0.9 + 0.1 * above) * (0.9 + 0.2 * fibres.at(u, v)) + sheen)
    })
}
