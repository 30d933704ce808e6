//! The rays through the pixels of a tile.

use crate::render::cpu::simd::each::each;
use crate::render::cpu::simd::isa::Kernel;
use crate::render::cpu::simd::{F32x16, FloatLike, N_LANES, Simd, SimdF32};
use crate::render::cpu::visibility::raster::MAX_TILES;
use crate::render::cpu::visibility::tile::{Tile4x4, TileLayout};
use crate::render::scene::camera::PinholeCamera;

/// RayTable of sixteen pixels, d = (x, y, 1) from the eye outwards.
pub(in crate::render::cpu) struct ViewRays<S: Simd> {
    /// Columns and rows of the pixels.
    pub(in crate::render::cpu) pixel: [S::F; 2],
    /// x and y of d.
    pub(in crate::render::cpu) d: [S::F; 2],
    /// 1/|d|.
    pub(in crate::render::cpu) inv_length: S::F,
    /// 1/z of what is seen.
    pub(in crate::render::cpu) depth: S::F,
}

impl<S: Simd> ViewRays<S> {
    /// The same at other depths.
    #[inline(always)]
    pub(in crate::render::cpu) fn at(self, depths: &F32x16) -> Self {
        Self { depth: S::F::load(depths), ..self }
    }
}

/// A camera's rays. Their lengths are kept: they are the same in every picture of cameras of the same make.
pub(in crate::render::cpu) struct RayTable {
    side: usize,
    focal_px: f32,
    /// x and y of d at the image's middle.
    middle: [f32; 2],
    inv_length: Vec<F32x16>,
}

/// Makes rays a camera's.
pub(in crate::render::cpu) struct ComputeRayTable<'a> {
    pub(in crate::render::cpu) rays: &'a mut RayTable,
    pub(in crate::render::cpu) camera: &'a PinholeCamera,
}

impl Kernel for ComputeRayTable<'_> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self { rays, camera } = self;
        (rays.side, rays.focal_px, rays.middle) = (camera.side, camera.focal_px, camera.image_centre);
        rays.inv_length.clear();
        let per_row = camera.side >> Tile4x4::WIDTH_BITS;
        for tile in 0..per_row * per_row {
            let (column, row) = (tile % per_row, tile / per_row);
            let first = [(column << Tile4x4::WIDTH_BITS) as f32, (row << Tile4x4::HEIGHT_BITS) as f32];
            let mut line = F32x16::ZERO;
            inv_length::<S>(rays.d::<S>(rays.pixel::<S>(first))).store(&mut line);
            rays.inv_length.push(line);
        }
    }
}

impl RayTable {
    /// Of no camera yet.
    pub(in crate::render::cpu) fn new() -> Self {
        Self { side: 0, focal_px: 0.0, middle: [0.0; 2], inv_length: Vec::with_capacity(MAX_TILES) }
    }

    /// Whether these are the camera's.
    pub(in crate::render::cpu) fn matches(&self, camera: &PinholeCamera) -> bool {
        let bits = |focal_px: f32, [x, y]: [f32; 2]| [focal_px, x, y].map(f32::to_bits);
        self.side == camera.side
            && bits(self.focal_px, self.middle) == bits(camera.focal_px, camera.image_centre)
    }

    /// RayTable of a tile, by its column and row; what they see is 1 m deep until it is said otherwise.
    #[inline(always)]
    pub(in crate::render::cpu) fn tile<S: Simd>(&self, column: usize, row: usize) -> ViewRays<S> {
        let per_row = self.side >> Tile4x4::WIDTH_BITS;
        let first = [(column << Tile4x4::WIDTH_BITS) as f32, (row << Tile4x4::HEIGHT_BITS) as f32];
        let pixel = self.pixel::<S>(first);
        ViewRays {
            pixel,
            d: self.d::<S>(pixel),
            inv_length: S::F::load(&self.inv_length[row * per_row + column]),
            depth: S::F::splat(1.0),
        }
    }

    /// RayTable through any pixels: the same as in their tiles.
    #[inline(always)]
    pub(in crate::render::cpu) fn for_pixels<S: Simd>(&self, pixel: [S::F; 2], depth: S::F) -> ViewRays<S> {
        let d = self.d::<S>(pixel);
        ViewRays { pixel, d, inv_length: inv_length::<S>(d), depth }
    }

    /// x and y of d at the corners of a row of `n` tiles.
    #[inline(always)]
    pub(in crate::render::cpu) fn corners(&self, column: usize, row: usize, n: usize) -> [[f32; 2]; 4] {
        let inv_focal = 1.0 / self.focal_px;
        let d = |pixel: usize, k: usize| {
            (pixel as f32 + 0.5 - self.side as f32 / 2.0) * inv_focal + self.middle[k]
        };
        let (left, top) = (column << Tile4x4::WIDTH_BITS, row << Tile4x4::HEIGHT_BITS);
        let (right, bottom) = (left + (n << Tile4x4::WIDTH_BITS), top + Tile4x4::HEIGHT as usize);
        let [left, right] = [d(left, 0), d(right, 0)];
        let [top, bottom] = [d(top, 1), d(bottom, 1)];
        [[left, top], [right, top], [left, bottom], [right, bottom]]
    }

    /// Columns and rows of the same lane's pixel in the sixteen tiles of a tile_row, by the first tile's column and row.
    #[inline(always)]
    pub(in crate::render::cpu) fn pixels_of_tile_row<S: Simd>(
        [column, row]: [usize; 2],
        lane: usize,
    ) -> [S::F; 2] {
        let [right, down] = Tile4x4::PIXELS[lane];
        let x = ((column << Tile4x4::WIDTH_BITS) as i32 + right) as f32;
        let y = ((row << Tile4x4::HEIGHT_BITS) as i32 + down) as f32;
        [S::F::splat(x) + S::F::load(&TILE_STARTS), S::F::splat(y)]
    }

    /// Columns and rows of the pixels of a tile with this first one.
    #[inline(always)]
    fn pixel<S: Simd>(&self, [x, y]: [f32; 2]) -> [S::F; 2] {
        [S::F::splat(x) + S::F::load(&Tile4x4::X_FLOATS), S::F::splat(y) + S::F::load(&Tile4x4::Y_FLOATS)]
    }

    #[inline(always)]
    fn d<S: Simd>(&self, pixel: [S::F; 2]) -> [S::F; 2] {
        let inv_focal = 1.0 / self.focal_px;
        let first = (0.5 - self.side as f32 / 2.0) * inv_focal;
        each!(k in 2 => pixel[k].mul_add(S::F::splat(inv_focal), S::F::splat(first + self.middle[k])))
    }
}

#[inline(always)]
fn inv_length<S: Simd>([x, y]: [S::F; 2]) -> S::F {
    S::F::splat(1.0) / x.mul_add(x, y.mul_add(y, S::F::splat(1.0))).sqrt()
}

/// Columns of the first pixels of a tile_row's tiles.
const TILE_STARTS: F32x16 = {
    let mut line = F32x16::ZERO;
    let mut i = 0;
    while i < N_LANES {
        line.0[i] = (i << Tile4x4::WIDTH_BITS) as f32;
        i += 1;
    }
    line
};
