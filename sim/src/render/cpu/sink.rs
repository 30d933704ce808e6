//! Where shaded pixels go: into the picture, into a layer, or into the picture over a layer.

use super::kind::{Block, Square};
use super::shade::Sink;
use super::simd::{Mask, Simd, Whole, WholeLine};

/// The picture: `[side, side, 3] u8`.
pub(super) struct Picture<'a> {
    pub(super) out: &'a mut [u8],
    pub(super) side: usize,
}

impl Picture<'_> {
    #[inline(always)]
    fn store<S: Simd>(&mut self, column: usize, row: usize, pixels: S::I) {
        let pitch = self.side * 3;
        let first = (row << Square::HEIGHT_BITS) * pitch + (column << Square::WIDTH_BITS) * 3;
        S::store_rgb(pixels, &mut self.out[first..], pitch);
    }
}

impl Sink for Picture<'_> {
    #[inline(always)]
    fn put<S: Simd>(&mut self, column: usize, row: usize, pixels: S::I, _nothing: S::M) {
        self.store::<S>(column, row, pixels);
    }
}

/// A layer's pixels.
pub(super) struct Kept<'a>(pub(super) &'a mut Vec<WholeLine>);

impl Sink for Kept<'_> {
    #[inline(always)]
    fn put<S: Simd>(&mut self, _column: usize, _row: usize, pixels: S::I, _nothing: S::M) {
        let mut line = WholeLine::ZERO;
        pixels.store(&mut line);
        self.0.push(line);
    }
}

/// The picture, where nothing moves as in a layer.
pub(super) struct Over<'a> {
    pub(super) layer: &'a [WholeLine],
    pub(super) picture: Picture<'a>,
}

impl Sink for Over<'_> {
    #[inline(always)]
    fn put<S: Simd>(&mut self, column: usize, row: usize, pixels: S::I, nothing: S::M) {
        let per_row = self.picture.side >> Square::WIDTH_BITS;
        let below = S::I::load(&self.layer[row * per_row + column]);
        let pixels = if nothing.any() { below.or_where(nothing, pixels) } else { pixels };
        self.picture.store::<S>(column, row, pixels);
    }
}
