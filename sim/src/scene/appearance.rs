//! Distribution of the appearance of a part or visual: nominal colour, texture and specular strength, and the
//! degree to which a perturbation varies them.

use super::texture::Texture;

/// Converts an sRGB colour from 8-bit channels to channels in [0, 1].
#[must_use]
pub const fn rgb([r, g, b]: [u8; 3]) -> [f64; 3] {
    [r as f64 / 255.0, g as f64 / 255.0, b as f64 / 255.0]
}

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
    /// Nominal sRGB colour, channels in [0, 1].
    pub color: [f64; 3],
    /// Nominal texture, multiplied by the colour.
    pub texture: Option<Texture>,
    /// Specular strength in [0, 1].
    pub specular: f64,
    /// Variation around the nominal colour and texture.
    pub variation: AppearanceVariation,
}

impl AppearanceSpec {
    /// Creates an untextured appearance with a weak specular highlight; `color` is sRGB in [0, 1].
    #[must_use]
    pub const fn plain(color: [f64; 3]) -> Self {
        Self { color, texture: None, specular: 0.2, variation: AppearanceVariation::NONE }
    }

    /// Creates a matt appearance whose texture is multiplied by `color` (sRGB in [0, 1]).
    #[must_use]
    pub const fn textured(texture: Texture, color: [f64; 3]) -> Self {
        Self { color, texture: Some(texture), specular: 0.0, variation: AppearanceVariation::NONE }
    }
}
