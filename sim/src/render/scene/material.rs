//! Surface materials in linear light.

use crate::render::math::affine::Vec3;
use crate::render::math::srgb;
use crate::scene::{Appearance, Texture};

/// Material of an instance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::render) struct Material {
    /// Albedo, linear RGB.
    pub(in crate::render) color: Vec3,
    /// Strength of the specular highlight in [0, 1].
    pub(in crate::render) specular: f32,
    /// Texture that modulates the albedo.
    pub(in crate::render) texture: Option<Texture>,
}

impl Material {
    /// Returns an untextured material of an sRGB colour in [0, 1].
    pub(in crate::render) fn plain(srgb_color: [f64; 3], specular: f32) -> Self {
        Self { color: srgb_color.map(srgb::decode), specular, texture: None }
    }
}

impl From<Appearance> for Material {
    fn from(appearance: Appearance) -> Self {
        Self {
            color: appearance.color.map(srgb::decode),
            specular: appearance.specular as f32,
            texture: appearance.texture,
        }
    }
}
