//! Shadows of the first directional light: a map of heights along the light, and its lookup.

mod height_map;
mod light_projection;
mod lookup;
mod map;
mod max_heights;
mod size;

pub(crate) use height_map::{StaticHeights, StaticHeightsKey};
pub(crate) use lookup::{LightBounds, LightBoundsBuilder, Shadow};
pub(crate) use map::{HeightRaster, ShadowMap};
pub(crate) use max_heights::MaxHeightPyramid;
