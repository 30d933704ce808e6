//! Colours and appearances of distractor objects, sampled from the object's stream.

pub(crate) use crate::srgb;
use crate::stream::Stream;
use crate::{AppearanceSpec, Range, Texture};

/// Near white, like glazed ceramic.
pub(crate) const WHITE: [f64; 3] = srgb([237, 237, 235]);
/// Near black, like dark plastic.
pub(crate) const BLACK: [f64; 3] = srgb([20, 20, 23]);
/// Gold, of metal or print.
pub(crate) const GOLD: [f64; 3] = srgb([206, 164, 66]);

/// Saturated colours of print and plastic.
const VIVID: [[f64; 3]; 12] = [
    srgb([190, 24, 32]),
    srgb([222, 92, 26]),
    srgb([238, 180, 24]),
    srgb([112, 160, 36]),
    srgb([28, 118, 62]),
    srgb([22, 138, 140]),
    srgb([40, 132, 204]),
    srgb([26, 62, 150]),
    srgb([92, 48, 138]),
    srgb([190, 46, 120]),
    srgb([112, 66, 36]),
    srgb([44, 52, 66]),
];

/// Light colours of glaze and paper.
const PALE: [[f64; 3]; 7] = [
    WHITE,
    srgb([240, 228, 196]),
    srgb([200, 220, 234]),
    srgb([206, 226, 196]),
    srgb([240, 206, 200]),
    srgb([226, 214, 236]),
    srgb([180, 186, 190]),
];

/// Draws one of `choices` uniformly.
pub(crate) fn pick<T: Copy>(stream: &mut Stream, choices: &[T]) -> T {
    *stream.choose(choices)
}

/// Multiplies a colour by a random factor in [0.7, 1.2].
pub(crate) fn vary_brightness(stream: &mut Stream, color: [f64; 3]) -> [f64; 3] {
    let factor = stream.uniform(Range::new(0.7, 1.2));
    color.map(|channel| (channel * factor).min(1.0))
}

/// Draws a saturated colour.
pub(crate) fn vivid(stream: &mut Stream) -> [f64; 3] {
    let color = pick(stream, &VIVID);
    vary_brightness(stream, color)
}

/// Draws `N` saturated colours of different hues; `N` is at most 12.
pub(crate) fn vivid_colors<const N: usize>(stream: &mut Stream) -> [[f64; 3]; N] {
    let first = (stream.unit() * VIVID.len() as f64) as usize;
    // 5 and 12 are coprime, so stepping by 5 visits every colour once.
    core::array::from_fn(|i| vary_brightness(stream, VIVID[(first + 5 * i) % VIVID.len()]))
}

/// Draws a light colour.
pub(crate) fn pale(stream: &mut Stream) -> [f64; 3] {
    pick(stream, &PALE)
}

/// Specular strength of fruit skin.
pub(crate) const PEEL_SPECULAR: f64 = 0.4;

/// Returns an almost purely diffuse appearance: paper, cloth or foam.
pub(crate) const fn matt(color: [f64; 3]) -> AppearanceSpec {
    AppearanceSpec { specular: 0.05, ..AppearanceSpec::plain(color) }
}

/// Returns the appearance of plastic or glaze.
pub(crate) const fn glossy(color: [f64; 3]) -> AppearanceSpec {
    AppearanceSpec { specular: 0.5, ..AppearanceSpec::plain(color) }
}

/// Returns a textured appearance with a weak specular highlight.
pub(crate) const fn textured(texture: Texture, color: [f64; 3]) -> AppearanceSpec {
    AppearanceSpec { specular: 0.2, ..AppearanceSpec::textured(texture, color) }
}

/// Returns the appearance of brushed steel.
pub(crate) const fn steel() -> AppearanceSpec {
    AppearanceSpec { specular: 0.8, ..AppearanceSpec::textured(Texture::BrushedMetal, srgb([199, 201, 207])) }
}

/// Returns the appearance of dark metal.
pub(crate) const fn iron() -> AppearanceSpec {
    AppearanceSpec { specular: 0.6, ..AppearanceSpec::plain(srgb([92, 94, 99])) }
}

/// Draws the appearance of some kind of wood.
pub(crate) fn wood(stream: &mut Stream) -> AppearanceSpec {
    let color = pick(stream, &[srgb([214, 168, 112]), srgb([184, 128, 76]), srgb([226, 190, 140])]);
    AppearanceSpec::textured(
        pick(stream, &[Texture::Wood, Texture::Walnut, Texture::Bamboo]),
        vary_brightness(stream, color),
    )
}
