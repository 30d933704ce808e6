//! Caches of the images and shadow heights of static geometry. They save work and do not change any byte.

pub(super) mod scene_cache;
pub(super) mod shared_cache;
pub(super) mod static_layer;
