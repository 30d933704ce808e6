//! The deferred shading stage: turns the visibility buffer into sRGB bytes, visiting each pixel tile once.

pub(super) mod antialias;
pub(super) mod encode;
pub(super) mod gathered;
pub(super) mod lighting;
pub(super) mod rays;
pub(super) mod sink;
pub(super) mod surface;
pub(super) mod texture;
pub(super) mod tiles;
