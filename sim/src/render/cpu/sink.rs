//! Where shaded pixels go: into the picture, into a layer, or into the picture over a layer.

use super::kind::{Block, Square};
use super::raster::NOTHING;
use super::shade::{STRIP, Sink, Strip};
use super::simd::{Lanes, Mask, Simd, Whole, WholeLine};

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

    /// Index of a strip's first byte.
    #[inline(always)]
    fn first(&self, strip: &Strip) -> usize {
        ((strip.row << Square::HEIGHT_BITS) * self.side + (strip.column << Square::WIDTH_BITS)) * RGB
    }

    /// Copies the strip's rows into the picture.
    #[inline(always)]
    fn copy(&mut self, strip: &Strip) {
        let (first, pitch) = (self.first(strip), self.side * RGB);
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
    fn take<S: Simd>(&mut self, strip: &Strip, _ids: &[WholeLine]) {
        for i in 0..strip.n {
            S::store_rgb(strip.packed::<S>(i), &mut self.rows.0, i * BLOCK_ROW);
        }
        self.copy(strip);
    }
}

/// The picture where what moves is drawn over a copy of a layer.
pub(super) struct Over<'a> {
    picture: Picture<'a>,
}

impl<'a> Over<'a> {
    /// The layer is a picture of the same side.
    pub(super) fn new(layer: &[u8], out: &'a mut [u8], side: usize) -> Self {
        out.copy_from_slice(layer);
        Self { picture: Picture::new(out, side) }
    }
}

impl Sink for Over<'_> {
    #[inline(always)]
    fn take<S: Simd>(&mut self, strip: &Strip, ids: &[WholeLine]) {
        let (first, pitch) = (self.picture.first(strip), self.picture.side * RGB);
        let out = &mut *self.picture.out;
        for block in Lanes(strip.lit()) {
            let pixels = strip.packed::<S>(block);
            let mut rows = [[0; BLOCK_ROW + 4]; N_ROWS];
            S::store_rgb(pixels, &mut rows, 0);
            let shows_something = S::I::load(&ids[block]).gt(S::I::all(NOTHING)).to_bits();
            for (y, row) in rows.iter().enumerate() {
                let out = &mut out[first + y * pitch + block * BLOCK_ROW..][..BLOCK_ROW];
                match shows_something >> (y * 4) & 0b1111 {
                    0 => {}
                    0b1111 => out.copy_from_slice(&row[..BLOCK_ROW]),
                    some => {
                        for x in (0..4).filter(|x| some >> x & 1 == 1) {
                            out[x * RGB..][..RGB].copy_from_slice(&row[x * RGB..][..RGB]);
                        }
                    }
                }
            }
        }
    }
}
