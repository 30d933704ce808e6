//! Where shaded pixels go: into the picture, into a layer, or into the picture over a layer.

use crate::render::cpu::shading::tiles::{TileRow, TileSink};
use crate::render::cpu::simd::each::each;
use crate::render::cpu::simd::{SetBits, Simd};
use crate::render::cpu::visibility::tile::{Tile4x4, TileLayout};

/// Bytes of a pixel.
const RGB: usize = 3;
/// Bytes of a tile's row.
const TILE_ROW_BYTES: usize = Tile4x4::WIDTH as usize * RGB;
/// Rows of a tile.
const N_ROWS: usize = Tile4x4::HEIGHT as usize;

/// Blocks that are written to the picture in one go.
const TILES_PER_WRITE: usize = 4;

/// The picture: `[side, side, 3] u8`.
pub(in crate::render::cpu) struct ImageSink<'a> {
    out: &'a mut [u8],
    side: usize,
}

impl<'a> ImageSink<'a> {
    /// A picture of which `out` is all.
    pub(in crate::render::cpu) fn new(out: &'a mut [u8], side: usize) -> Self {
        assert!((side >> Tile4x4::WIDTH_BITS).is_multiple_of(TILES_PER_WRITE), "side {side}");
        Self { out, side }
    }

    /// The part of a tile_row's rows that is `N` bytes from a tile on.
    #[inline(always)]
    fn part<const N: usize>(&mut self, tile_row: &TileRow, tile: usize) -> [&mut [u8; N]; N_ROWS] {
        let (first, row) = ((tile_row.column + tile) * TILE_ROW_BYTES, tile_row.row << Tile4x4::HEIGHT_BITS);
        let pitch = self.side * RGB;
        let (upper, lower) = self.out[row * pitch..][..N_ROWS * pitch].split_at_mut(2 * pitch);
        let ((a, b), (c, d)) = (upper.split_at_mut(pitch), lower.split_at_mut(pitch));
        [within(a, first), within(b, first), within(c, first), within(d, first)]
    }
}

#[inline(always)]
fn within<const N: usize>(row: &mut [u8], first: usize) -> &mut [u8; N] {
    row[first..].first_chunk_mut().expect("tiles within the picture")
}

impl TileSink for ImageSink<'_> {
    #[inline(always)]
    fn write<S: Simd>(&mut self, tile_row: &TileRow) {
        for tile in (0..tile_row.n).step_by(TILES_PER_WRITE) {
            let pixels = each!(k in 4 => tile_row.packed::<S>(tile + k));
            S::store_rgb_x4(pixels, self.part(tile_row, tile));
        }
    }
}

/// The picture where tiles that are no longer as in a layer are drawn over a copy of it.
pub(in crate::render::cpu) struct OverlaySink<'a>(ImageSink<'a>);

impl<'a> OverlaySink<'a> {
    /// The layer is a picture of the same side.
    pub(in crate::render::cpu) fn new(layer: &[u8], out: &'a mut [u8], side: usize) -> Self {
        out.copy_from_slice(layer);
        Self(ImageSink::new(out, side))
    }
}

impl TileSink for OverlaySink<'_> {
    #[inline(always)]
    fn write<S: Simd>(&mut self, tile_row: &TileRow) {
        for tile in SetBits(tile_row.shown_tiles()) {
            S::store_rgb(tile_row.packed::<S>(tile), self.0.part(tile_row, tile));
        }
    }
}
