//! Where shaded pixels go: into the picture, into a layer, or into the picture over a layer.

use super::kind::{Block, Square};
use super::shade::{STRIP, Sink, Strip};
use super::simd::{Lanes, Simd};

/// Bytes of a pixel.
const RGB: usize = 3;
/// Bytes of a block's row.
const BLOCK_ROW: usize = Square::WIDTH as usize * RGB;
/// Bytes of a strip's row.
const STRIP_ROW: usize = STRIP * BLOCK_ROW;
/// Rows of a strip.
const N_ROWS: usize = Square::HEIGHT as usize;

/// The picture: `[side, side, 3] u8`.
pub(super) struct Picture<'a> {
    out: &'a mut [u8],
    side: usize,
    /// A strip's rows, put together here so that they are written to the picture in one go.
    rows: Rows,
}

/// Rows of a strip, with room for what [`Simd::store_rgb`] writes behind the last pixel.
#[repr(C, align(64))]
struct Rows([[u8; STRIP_ROW + 16]; N_ROWS]);

impl<'a> Picture<'a> {
    /// A picture of which `out` is all.
    pub(super) fn new(out: &'a mut [u8], side: usize) -> Self {
        Self { out, side, rows: Rows([[0; STRIP_ROW + 16]; N_ROWS]) }
    }

    /// Copies the strip's rows into the picture.
    #[inline(always)]
    fn copy(&mut self, strip: &Strip) {
        let (first, pitch) = (first(strip, self.side), self.side * RGB);
        for (i, row) in self.rows.0.iter().enumerate() {
            let out = &mut self.out[first + i * pitch..];
            // One of a known length is copied without a call.
            if strip.n == STRIP {
                out[..STRIP_ROW].copy_from_slice(&row[..STRIP_ROW]);
            } else {
                out[..strip.n * BLOCK_ROW].copy_from_slice(&row[..strip.n * BLOCK_ROW]);
            }
        }
    }
}

impl Sink for Picture<'_> {
    #[inline(always)]
    fn take<S: Simd>(&mut self, strip: &Strip) {
        for i in 0..strip.n {
            S::store_rgb(strip.packed::<S>(i), &mut self.rows.0, i * BLOCK_ROW);
        }
        self.copy(strip);
    }
}

/// The picture where blocks that are no longer as in a layer are drawn over a copy of it.
pub(super) struct Over<'a> {
    out: &'a mut [u8],
    side: usize,
}

impl<'a> Over<'a> {
    /// The layer is a picture of the same side.
    pub(super) fn new(layer: &[u8], out: &'a mut [u8], side: usize) -> Self {
        out.copy_from_slice(layer);
        Self { out, side }
    }
}

impl Sink for Over<'_> {
    #[inline(always)]
    fn take<S: Simd>(&mut self, strip: &Strip) {
        let (first, pitch) = (first(strip, self.side), self.side * RGB);
        for block in Lanes(strip.lit()) {
            let mut rows = [[0; BLOCK_ROW + 4]; N_ROWS];
            S::store_rgb(strip.packed::<S>(block), &mut rows, 0);
            for (y, row) in rows.iter().enumerate() {
                let out = &mut self.out[first + y * pitch + block * BLOCK_ROW..][..BLOCK_ROW];
                out.copy_from_slice(&row[..BLOCK_ROW]);
            }
        }
    }
}

/// Index of a strip's first byte in a picture of this side.
#[inline(always)]
fn first(strip: &Strip, side: usize) -> usize {
    ((strip.row << Square::HEIGHT_BITS) * side + (strip.column << Square::WIDTH_BITS)) * RGB
}
