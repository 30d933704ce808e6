//! Caches of what static cameras and lights see of static geometry. They save work and change no byte.

pub(super) mod scene_cache;
pub(super) mod shared_cache;
pub(super) mod static_layer;
