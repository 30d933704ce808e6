//! The deferred shading stage: turns the visibility buffer into sRGB bytes, visiting each pixel tile once.

pub(crate) mod antialias;
pub(crate) mod encode;
pub(crate) mod gathered;
pub(crate) mod lighting;
pub(crate) mod rays;
pub(crate) mod sink;
pub(crate) mod surface;
pub(crate) mod texture;
pub(crate) mod tiles;
