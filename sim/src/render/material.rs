//! What a surface looks like, in linear light.

use super::affine::Vec3;
use super::srgb;
use crate::scene::{Appearance, Texture};

/// Look of an instance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Material {
    /// Diffuse reflectance, linear RGB.
    pub(super) color: Vec3,
    /// Strength of the highlight in [0, 1].
    pub(super) specular: f32,
    /// Pattern that multiplies the colour.
    pub(super) texture: Option<Texture>,
}

impl Material {
    /// A plain colour, sRGB in [0, 1].
    pub(super) fn plain(srgb_color: [f64; 3], specular: f32) -> Self {
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
