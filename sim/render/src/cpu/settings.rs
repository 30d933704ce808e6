//! Options of the CPU renderer, and the settings that all of its passes share.

use super::cache::shared_cache::SharedCache;
use super::cache::static_layer::{StaticLayer, StaticLayerKey};
use super::shadow::{StaticHeights, StaticHeightsKey};
use super::simd::isa::Isa;
use crate::Samples;

/// Options of a CPU renderer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CpuOptions {
    /// `true` to cache, per static camera, a layer with the rendered static geometry, shared by all scenes
    /// whose static geometry is identical. Does not change any byte. A layer takes 12 bytes per pixel, and 25
    /// more with four samples per pixel. The shadow map of the static geometry is always cached: 0.8 MB,
    /// shared likewise.
    pub static_layers: bool,
    /// Number of visibility samples per pixel.
    pub samples: Samples,
}

impl Default for CpuOptions {
    fn default() -> Self {
        Self { static_layers: true, samples: Samples::One }
    }
}

/// Instruction set, options, and caches of static geometry, which all passes share.
pub(crate) struct RenderSettings {
    pub(crate) isa: Isa,
    pub(crate) options: CpuOptions,
    pub(crate) layers: SharedCache<StaticLayerKey, StaticLayer>,
    pub(crate) static_heights: SharedCache<StaticHeightsKey, StaticHeights>,
}
