//! Surface materials in linear light.

use crate::math::affine::Vec3;
use scene::{Appearance, Texture};

/// Specular reflectance of the strongest highlights of a non-metal.
const MAX_SPECULAR: f64 = 0.08;

/// Material of an instance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Material {
    /// Albedo, linear RGB.
    pub(crate) color: Vec3,
    /// Specular reflectance in white; 0 for a metal.
    pub(crate) specular: f32,
    /// 1 for a metal, which reflects directional light only specularly and in its own colour.
    pub(crate) metallic: f32,
    /// Texture that modulates the albedo.
    pub(crate) texture: Option<Texture>,
}

impl Material {
    /// Returns a matt, untextured material of a linear colour in [0, 1].
    pub(crate) fn plain(color: Vec3) -> Self {
        Self { color, specular: 0.0, metallic: 0.0, texture: None }
    }
}

impl From<Appearance> for Material {
    fn from(appearance: Appearance) -> Self {
        Self {
            color: appearance.color.map(|c| c as f32),
            specular: (MAX_SPECULAR * appearance.specular * (1.0 - appearance.metallic)) as f32,
            metallic: appearance.metallic as f32,
            texture: appearance.texture,
        }
    }
}
