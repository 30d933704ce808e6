//! Destinations of shaded pixels: an image, or an image on top of a copy of a static layer.

use crate::cpu::shading::tiles::{TileRow, TileSink};
use crate::cpu::simd::each::each;
use crate::cpu::simd::{SetBits, Simd};
use crate::cpu::visibility::tile::{Tile4x4, TileLayout};

/// Bytes per pixel.
const RGB: usize = 3;
/// Bytes per row of a tile.
const TILE_ROW_BYTES: usize = Tile4x4::WIDTH as usize * RGB;
/// Pixel rows per tile.
const N_ROWS: usize = Tile4x4::HEIGHT as usize;

/// Number of tiles that one store writes.
const TILES_PER_WRITE: usize = 4;

/// Sink that writes every tile to an image, `[side, side, 3] u8` sRGB.
pub(crate) struct ImageSink<'a> {
    out: &'a mut [u8],
    side: usize,
}

impl<'a> ImageSink<'a> {
    /// Creates a sink for the image `out`, `[side, side, 3] u8`. `side` must be a multiple of 16 px.
    pub(crate) fn new(out: &'a mut [u8], side: usize) -> Self {
        assert!((side >> Tile4x4::WIDTH_BITS).is_multiple_of(TILES_PER_WRITE), "side {side}");
        Self { out, side }
    }

    /// Returns `N` bytes of each pixel row of a tile row, from the left edge of `tile` on.
    #[inline(always)]
    fn pixel_rows<const N: usize>(&mut self, tile_row: &TileRow, tile: usize) -> [&mut [u8; N]; N_ROWS] {
        let (first, row) = ((tile_row.column + tile) * TILE_ROW_BYTES, tile_row.row << Tile4x4::HEIGHT_BITS);
        let pitch = self.side * RGB;
        let (upper, lower) = self.out[row * pitch..][..N_ROWS * pitch].split_at_mut(2 * pitch);
        let ((a, b), (c, d)) = (upper.split_at_mut(pitch), lower.split_at_mut(pitch));
        [chunk_at(a, first), chunk_at(b, first), chunk_at(c, first), chunk_at(d, first)]
    }
}

#[inline(always)]
fn chunk_at<const N: usize>(row: &mut [u8], first: usize) -> &mut [u8; N] {
    row[first..].first_chunk_mut().expect("tiles must lie within the image")
}

impl TileSink for ImageSink<'_> {
    #[inline(always)]
    fn write<S: Simd>(&mut self, tile_row: &TileRow) {
        for tile in (0..tile_row.n).step_by(TILES_PER_WRITE) {
            let pixels = each!(k in 4 => tile_row.packed::<S>(tile + k));
            S::store_rgb_x4(pixels, self.pixel_rows(tile_row, tile));
        }
    }
}

/// Sink that copies a static layer to an image and overwrites the tiles that were shaded again.
pub(crate) struct OverlaySink<'a>(ImageSink<'a>);

impl<'a> OverlaySink<'a> {
    /// Creates a sink for the image `out`; both images are `[side, side, 3] u8`.
    pub(crate) fn new(layer: &[u8], out: &'a mut [u8], side: usize) -> Self {
        out.copy_from_slice(layer);
        Self(ImageSink::new(out, side))
    }
}

impl TileSink for OverlaySink<'_> {
    #[inline(always)]
    fn write<S: Simd>(&mut self, tile_row: &TileRow) {
        for tile in SetBits(tile_row.shown_tiles()) {
            S::store_rgb(tile_row.packed::<S>(tile), self.0.pixel_rows(tile_row, tile));
        }
    }
}
