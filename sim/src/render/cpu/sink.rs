//! Where shaded pixels go: into the picture, into a layer, or into the picture over a layer.

use super::each::each;
use super::kind::{Block, Square};
use super::shade::{Sink, Strip};
use super::simd::{SetBits, Simd};

/// Bytes of a pixel.
const RGB: usize = 3;
/// Bytes of a block's row.
const BLOCK_ROW: usize = Square::WIDTH as usize * RGB;
/// Rows of a block.
const N_ROWS: usize = Square::HEIGHT as usize;

/// Blocks that are written to the picture in one go.
const QUAD: usize = 4;

/// The picture: `[side, side, 3] u8`.
pub(super) struct Picture<'a> {
    out: &'a mut [u8],
    side: usize,
}

impl<'a> Picture<'a> {
    /// A picture of which `out` is all.
    pub(super) fn new(out: &'a mut [u8], side: usize) -> Self {
        assert!((side >> Square::WIDTH_BITS).is_multiple_of(QUAD), "side {side}");
        Self { out, side }
    }

    /// The part of a strip's rows that is `N` bytes from a block on.
    #[inline(always)]
    fn part<const N: usize>(&mut self, strip: &Strip, block: usize) -> [&mut [u8; N]; N_ROWS] {
        let (first, row) = ((strip.column + block) * BLOCK_ROW, strip.row << Square::HEIGHT_BITS);
        let pitch = self.side * RGB;
        let (upper, lower) = self.out[row * pitch..][..N_ROWS * pitch].split_at_mut(2 * pitch);
        let ((a, b), (c, d)) = (upper.split_at_mut(pitch), lower.split_at_mut(pitch));
        [within(a, first), within(b, first), within(c, first), within(d, first)]
    }
}

#[inline(always)]
fn within<const N: usize>(row: &mut [u8], first: usize) -> &mut [u8; N] {
    row[first..].first_chunk_mut().expect("blocks within the picture")
}

impl Sink for Picture<'_> {
    #[inline(always)]
    fn take<S: Simd>(&mut self, strip: &Strip) {
        for block in (0..strip.n).step_by(QUAD) {
            let pixels = each!(k in 4 => strip.packed::<S>(block + k));
            S::store_rgb_x4(pixels, self.part(strip, block));
        }
    }
}

/// The picture where blocks that are no longer as in a layer are drawn over a copy of it.
pub(super) struct Over<'a>(Picture<'a>);

impl<'a> Over<'a> {
    /// The layer is a picture of the same side.
    pub(super) fn new(layer: &[u8], out: &'a mut [u8], side: usize) -> Self {
        out.copy_from_slice(layer);
        Self(Picture::new(out, side))
    }
}

impl Sink for Over<'_> {
    #[inline(always)]
    fn take<S: Simd>(&mut self, strip: &Strip) {
        for block in SetBits(strip.lit()) {
            S::store_rgb(strip.packed::<S>(block), self.0.part(strip, block));
        }
    }
}
