//! What something looks like, and how far that varies.

use super::texture::Texture;

/// An sRGB colour whose channels are given in 0 to 255.
#[must_use]
pub const fn rgb([r, g, b]: [u8; 3]) -> [f64; 3] {
    [r as f64 / 255.0, g as f64 / 255.0, b as f64 / 255.0]
}

/// How far a look is drawn anew: 0 keeps it, 1 lets it be anything. Where both may change, a coin tells which of them does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Variation {
    /// Each channel of the colour lies this far on the way from the nominal one to one uniform in [0, 1]; with this chance
    /// the pattern goes.
    pub color: f64,
    /// Chance of any pattern, untinted, in place of the look.
    pub texture: f64,
}

impl Variation {
    /// As it is.
    pub const NONE: Self = Self { color: 0.0, texture: 0.0 };
}

/// Look of one part or visual.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaintSpec {
    /// Colour, sRGB in [0, 1].
    pub color: [f64; 3],
    /// Pattern tinted by the colour.
    pub texture: Option<Texture>,
    /// Strength of the highlight in [0, 1].
    pub specular: f64,
    /// How far colour and pattern are drawn anew.
    pub variation: Variation,
}

impl PaintSpec {
    /// A plain colour with a faint highlight; sRGB in [0, 1].
    #[must_use]
    pub const fn plain(color: [f64; 3]) -> Self {
        Self { color, texture: None, specular: 0.2, variation: Variation::NONE }
    }

    /// A matt pattern tinted by a colour.
    #[must_use]
    pub const fn textured(texture: Texture, color: [f64; 3]) -> Self {
        Self { color, texture: Some(texture), specular: 0.0, variation: Variation::NONE }
    }
}
