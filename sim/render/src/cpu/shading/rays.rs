//! View rays through the pixel centres of a tile.

use ipc_types::ImageSize;

use crate::cpu::simd::each::each;
use crate::cpu::simd::isa::Kernel;
use crate::cpu::simd::{F32x16, FloatLike, N_LANES, Simd, SimdF32};
use crate::cpu::visibility::tile::{Tile4x4, TileLayout};
use crate::prepared::camera::PinholeCamera;

/// View rays of sixteen pixels, with directions d = (x, y, 1) that point away from the eye.
pub(crate) struct ViewRays<S: Simd> {
    /// Columns and rows of the pixels.
    pub(crate) pixel: [S::F; 2],
    /// x and y components of d.
    pub(crate) d: [S::F; 2],
    /// Reciprocal lengths 1/|d|.
    pub(crate) inv_length: S::F,
    /// 1/z of the visible surfaces.
    pub(crate) depth: S::F,
}

impl<S: Simd> ViewRays<S> {
    /// Returns the same rays with other depths (1/z).
    #[inline(always)]
    pub(crate) fn at(self, depths: &F32x16) -> Self {
        Self { depth: S::F::load(depths), ..self }
    }
}

/// The view rays of a camera. The reciprocal ray lengths are cached, since they depend on the intrinsics
/// alone.
pub(crate) struct RayTable {
    size: ImageSize,
    focal_px: f32,
    /// Number of tiles in a row.
    pitch: usize,
    /// 1/|d| per tile.
    inv_length: Vec<F32x16>,
}

/// Kernel that fills a ray table for a camera.
pub(crate) struct ComputeRayTable<'a> {
    pub(crate) rays: &'a mut RayTable,
    pub(crate) camera: &'a PinholeCamera,
}

impl Kernel for ComputeRayTable<'_> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self { rays, camera } = self;
        let [n_columns, n_rows] = Tile4x4::cover(camera.size);
        (rays.size, rays.focal_px, rays.pitch) = (camera.size, camera.focal_px, n_columns);
        rays.inv_length.clear();
        for tile in 0..n_columns * n_rows {
            let (column, row) = (tile % n_columns, tile / n_columns);
            let first = [(column << Tile4x4::WIDTH_BITS) as f32, (row << Tile4x4::HEIGHT_BITS) as f32];
            let mut inv_lengths = F32x16::ZERO;
            inv_length::<S>(rays.d::<S>(rays.pixel::<S>(first))).store(&mut inv_lengths);
            rays.inv_length.push(inv_lengths);
        }
    }
}

impl RayTable {
    /// Creates an empty table that matches no camera.
    pub(crate) fn new() -> Self {
        Self { size: ImageSize::square(0), focal_px: 0.0, pitch: 0, inv_length: Vec::new() }
    }

    /// Returns `true` if the table was computed for the intrinsics of `camera`.
    pub(crate) fn matches(&self, camera: &PinholeCamera) -> bool {
        self.size == camera.size && self.focal_px.to_bits() == camera.focal_px.to_bits()
    }

    /// Returns the rays of a tile, given its column and row. Their depth is 1 until [`ViewRays::at`]
    /// replaces it.
    #[inline(always)]
    pub(crate) fn tile<S: Simd>(&self, column: usize, row: usize) -> ViewRays<S> {
        let first = [(column << Tile4x4::WIDTH_BITS) as f32, (row << Tile4x4::HEIGHT_BITS) as f32];
        let pixel = self.pixel::<S>(first);
        ViewRays {
            pixel,
            d: self.d::<S>(pixel),
            inv_length: S::F::load(&self.inv_length[row * self.pitch + column]),
            depth: S::F::splat(1.0),
        }
    }

    /// Returns the rays through arbitrary pixels. They are identical to those of [`Self::tile`].
    #[inline(always)]
    pub(crate) fn for_pixels<S: Simd>(&self, pixel: [S::F; 2], depth: S::F) -> ViewRays<S> {
        let d = self.d::<S>(pixel);
        ViewRays { pixel, d, inv_length: inv_length::<S>(d), depth }
    }

    /// Returns the column and row of the pixel of one lane in each of the sixteen tiles of a tile row,
    /// given the column and row of the first tile.
    #[inline(always)]
    pub(crate) fn pixels_of_tile_row<S: Simd>([column, row]: [usize; 2], lane: usize) -> [S::F; 2] {
        let [right, down] = Tile4x4::PIXELS[lane];
        let x = ((column << Tile4x4::WIDTH_BITS) as i32 + right) as f32;
        let y = ((row << Tile4x4::HEIGHT_BITS) as i32 + down) as f32;
        [S::F::splat(x) + S::F::load(&TILE_STARTS), S::F::splat(y)]
    }

    /// Returns the columns and rows of the pixels of the tile whose first pixel is (x, y).
    #[inline(always)]
    fn pixel<S: Simd>(&self, [x, y]: [f32; 2]) -> [S::F; 2] {
        [S::F::splat(x) + S::F::load(&Tile4x4::X_FLOATS), S::F::splat(y) + S::F::load(&Tile4x4::Y_FLOATS)]
    }

    #[inline(always)]
    fn d<S: Simd>(&self, pixel: [S::F; 2]) -> [S::F; 2] {
        let inv_focal = 1.0 / self.focal_px;
        let n_px = [self.size.width, self.size.height];
        each!(k in 2 => {
            let first = (0.5 - n_px[k] as f32 / 2.0) * inv_focal;
            pixel[k].mul_add(S::F::splat(inv_focal), S::F::splat(first))
        })
    }
}

#[inline(always)]
fn inv_length<S: Simd>([x, y]: [S::F; 2]) -> S::F {
    S::F::splat(1.0) / x.mul_add(x, y.mul_add(y, S::F::splat(1.0))).sqrt()
}

/// Columns of the first pixels of sixteen adjacent tiles, relative to the first tile.
const TILE_STARTS: F32x16 = {
    let mut columns = F32x16::ZERO;
    let mut i = 0;
    while i < N_LANES {
        columns.0[i] = (i << Tile4x4::WIDTH_BITS) as f32;
        i += 1;
    }
    columns
};
