//! The visibility stage: finds the nearest triangle and its depth for every pixel of an image or shadow map.
//!
//! It takes instances and their transforms and fills a [`raster::Visibility`] buffer, tile by tile.

pub(super) mod clip;
pub(super) mod instances;
pub(super) mod projection;
pub(super) mod raster;
pub(super) mod small_triangles;
pub(super) mod tile;
