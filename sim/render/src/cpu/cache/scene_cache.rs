//! The cache entries that a scene holds on to, so that lookups in the shared caches are needed only when
//! something static changes.

use std::sync::{Arc, Mutex};

use super::static_layer::StaticLayer;
use crate::cpu::shadow::StaticHeights;
use crate::prepared::RenderScene;

/// Cached values that the CPU renderer attaches to a scene. They affect speed only, never a byte of an image.
pub(crate) struct SceneCache {
    /// Static layer of each camera.
    pub(crate) layers: Vec<Mutex<Option<Arc<StaticLayer>>>>,
    /// Shadow map of the static instances.
    pub(crate) static_heights: Mutex<Option<Arc<StaticHeights>>>,
}

impl SceneCache {
    /// Returns the cache of a scene, empty on first use.
    pub(crate) fn of(scene: &RenderScene) -> &Self {
        scene.attachment.get_or_init(|| Self {
            layers: (0..scene.n_cameras()).map(|_| Mutex::default()).collect(),
            static_heights: Mutex::default(),
        })
    }
}
