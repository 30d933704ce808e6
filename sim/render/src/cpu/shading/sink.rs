//! Destinations of shaded pixels: an image, or an image on top of a copy of a static layer.

use ipc_types::ImageSize;

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

/// Sink that writes every tile to an image, `[height, width, 3] u8` sRGB.
pub(crate) struct ImageSink<'a> {
    out: &'a mut [u8],
    size: ImageSize,
}

impl<'a> ImageSink<'a> {
    /// Creates a sink for the image `out`, `[height, width, 3] u8`.
    pub(crate) fn new(out: &'a mut [u8], size: ImageSize) -> Self {
        Self { out, size }
    }

    /// Returns `N` bytes of each pixel row of a tile row, from the left edge of `tile` on, or `None` if some
    /// are outside the image.
    #[inline(always)]
    fn pixel_rows<const N: usize>(
        &mut self,
        tile_row: &TileRow,
        tile: usize,
    ) -> Option<[&mut [u8; N]; N_ROWS]> {
        let [first, top] = position(tile_row, tile);
        let pitch = self.size.width * RGB;
        if first + N > pitch {
            return None;
        }
        let (upper, lower) = self.out.get_mut(top * pitch..(top + N_ROWS) * pitch)?.split_at_mut(2 * pitch);
        let ((a, b), (c, d)) = (upper.split_at_mut(pitch), lower.split_at_mut(pitch));
        Some([chunk_at(a, first), chunk_at(b, first), chunk_at(c, first), chunk_at(d, first)])
    }

    /// Writes the part of four pixel rows from the left edge of `tile` on that is inside the image.
    #[inline(never)]
    fn write_part<const N: usize>(&mut self, tile_row: &TileRow, tile: usize, pixels: &[[u8; N]; N_ROWS]) {
        let [first, top] = position(tile_row, tile);
        let pitch = self.size.width * RGB;
        let n = N.min(pitch - first);
        for (row, pixels) in self.out.chunks_exact_mut(pitch).skip(top).zip(pixels) {
            row[first..first + n].copy_from_slice(&pixels[..n]);
        }
    }
}

/// Returns the first byte of a tile in its pixel rows, and the first of these.
#[inline(always)]
fn position(tile_row: &TileRow, tile: usize) -> [usize; 2] {
    [(tile_row.column + tile) * TILE_ROW_BYTES, tile_row.row << Tile4x4::HEIGHT_BITS]
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
            match self.pixel_rows(tile_row, tile) {
                Some(rows) => S::store_rgb_x4(pixels, rows),
                None => {
                    let mut rows = [[0; TILES_PER_WRITE * TILE_ROW_BYTES]; N_ROWS];
                    S::store_rgb_x4(pixels, rows.each_mut());
                    self.write_part(tile_row, tile, &rows);
                }
            }
        }
    }
}

/// Sink that copies a static layer to an image and overwrites the tiles that were shaded again.
pub(crate) struct OverlaySink<'a>(ImageSink<'a>);

impl<'a> OverlaySink<'a> {
    /// Creates a sink for the image `out`; both images are `[height, width, 3] u8`.
    pub(crate) fn new(layer: &[u8], out: &'a mut [u8], size: ImageSize) -> Self {
        out.copy_from_slice(layer);
        Self(ImageSink::new(out, size))
    }
}

impl TileSink for OverlaySink<'_> {
    #[inline(always)]
    fn write<S: Simd>(&mut self, tile_row: &TileRow) {
        for tile in SetBits(tile_row.shown_tiles()) {
            let pixels = tile_row.packed::<S>(tile);
            match self.0.pixel_rows(tile_row, tile) {
                Some(rows) => S::store_rgb(pixels, rows),
                None => {
                    let mut rows = [[0; TILE_ROW_BYTES]; N_ROWS];
                    S::store_rgb(pixels, rows.each_mut());
                    self.0.write_part(tile_row, tile, &rows);
                }
            }
        }
    }
}
