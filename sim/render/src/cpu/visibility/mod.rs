//! The visibility stage: finds the nearest triangle and its depth for every pixel of an image or shadow map.
//!
//! It takes instances and their transforms and fills a [`raster::Visibility`] buffer, tile by tile.

pub(crate) mod clip;
pub(crate) mod instances;
mod perspective;
pub(crate) mod projection;
pub(crate) mod raster;
pub(crate) mod small_triangles;
pub(crate) mod tile;
