//! Appearance of surfaces: colours, textures and distributions of both.

mod color;
mod spec;
mod texture;

pub use color::{decode_srgb, rgb, srgb};
pub use spec::{AppearanceSpec, AppearanceVariation};
pub use texture::Texture;
