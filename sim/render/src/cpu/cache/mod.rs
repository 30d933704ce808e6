//! Caches of the images and shadow heights of static geometry. They save work and do not change any byte.

pub(crate) mod scene_cache;
pub(crate) mod shared_cache;
pub(crate) mod static_layer;
