//! What things are coloured with, drawn from their stream.

pub(super) use crate::scene::rgb;
use crate::scene::{PaintSpec, Range, Texture};
use crate::stream::Stream;

/// Near white, and near black.
pub(super) const WHITE: [f64; 3] = [0.93, 0.93, 0.92];
pub(super) const BLACK: [f64; 3] = [0.08, 0.08, 0.09];
/// Yellow metal or its print.
pub(super) const GOLD: [f64; 3] = rgb([206, 164, 66]);

/// Strong colours of print and plastic.
const VIVID: [[f64; 3]; 12] = [
    rgb([190, 24, 32]),
    rgb([222, 92, 26]),
    rgb([238, 180, 24]),
    rgb([112, 160, 36]),
    rgb([28, 118, 62]),
    rgb([22, 138, 140]),
    rgb([40, 132, 204]),
    rgb([26, 62, 150]),
    rgb([92, 48, 138]),
    rgb([190, 46, 120]),
    rgb([112, 66, 36]),
    rgb([44, 52, 66]),
];

/// Light colours of glaze and paper.
const PALE: [[f64; 3]; 7] = [
    WHITE,
    rgb([240, 228, 196]),
    rgb([200, 220, 234]),
    rgb([206, 226, 196]),
    rgb([240, 206, 200]),
    rgb([226, 214, 236]),
    rgb([180, 186, 190]),
];

/// One of several, with equal chances.
pub(super) fn pick<T: Copy>(stream: &mut Stream, of: &[T]) -> T {
    *stream.choose(of)
}

/// A colour a little lighter or darker.
pub(super) fn shade(stream: &mut Stream, color: [f64; 3]) -> [f64; 3] {
    let factor = stream.uniform(Range::new(0.85, 1.1));
    color.map(|channel| (channel * factor).min(1.0))
}

/// A strong colour.
pub(super) fn vivid(stream: &mut Stream) -> [f64; 3] {
    let color = pick(stream, &VIVID);
    shade(stream, color)
}

/// `N` strong colours, no two alike.
pub(super) fn vivids<const N: usize>(stream: &mut Stream) -> [[f64; 3]; N] {
    let first = (stream.unit() * VIVID.len() as f64) as usize;
    // Five has no divisor with twelve, so that the walk meets every colour once.
    core::array::from_fn(|i| shade(stream, VIVID[(first + 5 * i) % VIVID.len()]))
}

/// A light colour.
pub(super) fn pale(stream: &mut Stream) -> [f64; 3] {
    pick(stream, &PALE)
}

/// Strength of the highlight on fruit.
pub(super) const PEEL: f64 = 0.4;

/// Without highlight: paper, cloth, foam.
pub(super) const fn matt(color: [f64; 3]) -> PaintSpec {
    PaintSpec { specular: 0.05, ..PaintSpec::plain(color) }
}

/// Plastic and glaze.
pub(super) const fn gloss(color: [f64; 3]) -> PaintSpec {
    PaintSpec { specular: 0.5, ..PaintSpec::plain(color) }
}

/// A pattern with some highlight.
pub(super) const fn patterned(texture: Texture, color: [f64; 3]) -> PaintSpec {
    PaintSpec { specular: 0.2, ..PaintSpec::textured(texture, color) }
}

/// Bare metal.
pub(super) const fn steel() -> PaintSpec {
    PaintSpec { specular: 0.8, ..PaintSpec::textured(Texture::BrushedMetal, [0.78, 0.79, 0.81]) }
}

/// Dark metal.
pub(super) const fn iron() -> PaintSpec {
    PaintSpec { specular: 0.6, ..PaintSpec::plain([0.36, 0.37, 0.39]) }
}

/// Some wood.
pub(super) fn wood(stream: &mut Stream) -> PaintSpec {
    let color = pick(stream, &[rgb([214, 168, 112]), rgb([184, 128, 76]), rgb([226, 190, 140])]);
    PaintSpec::textured(
        pick(stream, &[Texture::Wood, Texture::Walnut, Texture::Bamboo]),
        shade(stream, color),
    )
}
