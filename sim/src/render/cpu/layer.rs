//! What a camera that stands still sees of what never moves: drawn once, then only what moves is drawn over it.

use super::simd::Line;
use crate::render::affine::Affine;

/// The part of a picture that stays. It makes no difference to the bytes: what stays comes first in every picture.
#[derive(Default)]
pub(in crate::render) struct Layer {
    /// The maps of what stays, from its meshes to the view frame, for which the rest was drawn.
    pub(super) maps: Vec<Affine>,
    /// 1/z, block by block.
    pub(super) depths: Vec<Line>,
    /// The picture of it: `[side, side, 3]`.
    pub(super) pixels: Vec<u8>,
}

impl Layer {
    /// Whether it was drawn for these maps.
    pub(super) fn shows(&self, maps: &[Affine]) -> bool {
        self.maps == maps
    }
}
