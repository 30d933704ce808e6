//! The shading stage: turns a visibility buffer into sRGB bytes, visiting each tile of pixels once.

pub(super) mod antialias;
pub(super) mod encode;
pub(super) mod lighting;
pub(super) mod rays;
pub(super) mod sink;
pub(super) mod surface;
pub(super) mod texture;
pub(super) mod tiles;
