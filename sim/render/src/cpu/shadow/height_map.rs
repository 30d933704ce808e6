//! Maps of heights along the light.

use super::max_heights::MaxHeightPyramid;
use super::size::{SIDE, TILES};
use crate::cpu::simd::N_LANES;
use crate::math::affine::Affine3;
use crate::prepared::MeshKey;

/// Heights along the light, in steps, of back faces only: front faces would occasionally shadow themselves.
pub(crate) struct HeightMap {
    /// `[512, 512]` heights of the geometry drawn and of the map below it.
    pub(crate) texels: Vec<u16>,
    /// Maximum heights of the geometry drawn, without the map below.
    pub(crate) max_heights: MaxHeightPyramid,
    /// Bit mask of the occupied tiles, sixteen per element.
    pub(crate) filled: Vec<u16>,
}

impl HeightMap {
    /// Creates an empty map.
    pub(crate) fn new() -> Self {
        Self {
            texels: vec![0; SIDE * SIDE],
            max_heights: MaxHeightPyramid::new(),
            filled: vec![0; TILES * TILES / N_LANES],
        }
    }
}

/// Cached heights of static geometry.
pub(crate) struct StaticHeights {
    /// Transforms of the static instances to the light frame for which the map was rendered.
    pub(crate) maps: Vec<Affine3>,
    pub(crate) heights: HeightMap,
}

/// Cache key of [`StaticHeights`]: the meshes and their transforms to the light frame.
#[derive(PartialEq)]
pub(crate) struct StaticHeightsKey(pub(crate) Vec<(MeshKey, Affine3)>);
