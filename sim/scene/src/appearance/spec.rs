//! Distribution of the appearance of a part or visual: nominal colour, texture and specular strength, and the
//! degree to which a perturbation varies them.

use super::texture::Texture;

/// The degree to which colour and texture are resampled, from 0 (nominal) to 1 (anything).
///
/// If both are non-zero, a fair coin flip per episode decides which of the two is resampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AppearanceVariation {
    /// Interpolation weight of each colour channel from its nominal value (0) to a uniform sample from [0, 1]
    /// (1). A resampled colour also removes the texture with this probability.
    pub color: f64,
    /// Probability that colour and texture are replaced by a random untinted texture.
    pub texture: f64,
}

impl AppearanceVariation {
    /// No variation: the nominal appearance.
    pub const NONE: Self = Self { color: 0.0, texture: 0.0 };
}

/// Distribution of the appearance of one part or visual.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AppearanceSpec {
    /// Nominal colour, linear RGB in [0, 1].
    pub color: [f64; 3],
    /// Nominal texture, multiplied by the colour.
    pub texture: Option<Texture>,
    /// Strength of the highlights in [0, 1], unless it is a metal. At 1 it reflects 8 % specularly.
    pub specular: f64,
    /// 1 for a metal, whose highlights have its colour and which reflects directional light in no other way;
    /// 0 for anything else.
    pub metallic: f64,
    /// Variation around the nominal colour and texture.
    pub variation: AppearanceVariation,
}

impl AppearanceSpec {
    /// Creates a matt untextured appearance; `color` is linear RGB.
    #[must_use]
    pub const fn plain(color: [f64; 3]) -> Self {
        Self { color, texture: None, specular: 0.0, metallic: 0.0, variation: AppearanceVariation::NONE }
    }

    /// Creates an untextured metal; `color` is linear RGB.
    #[must_use]
    pub const fn metal(color: [f64; 3]) -> Self {
        Self { metallic: 1.0, ..Self::plain(color) }
    }

    /// Creates a matt appearance whose texture is multiplied by `color` (linear RGB).
    #[must_use]
    pub const fn textured(texture: Texture, color: [f64; 3]) -> Self {
        Self { texture: Some(texture), ..Self::plain(color) }
    }
}
