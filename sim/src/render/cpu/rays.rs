//! The rays through the pixels of a block.

use super::each::each;
use super::isa::Kernel;
use super::kind::{Block, Square};
use super::raster::MAX_BLOCKS;
use super::simd::{F32x16, FloatLike, N_LANES, Simd, SimdF32};
use crate::render::scene::camera::PinholeCamera;

/// Rays of sixteen pixels, d = (x, y, 1) from the eye outwards.
pub(super) struct Gaze<S: Simd> {
    /// Columns and rows of the pixels.
    pub(super) pixel: [S::F; 2],
    /// x and y of d.
    pub(super) d: [S::F; 2],
    /// 1/|d|.
    pub(super) per_length: S::F,
    /// 1/z of what is seen.
    pub(super) depth: S::F,
}

impl<S: Simd> Gaze<S> {
    /// The same at other depths.
    #[inline(always)]
    pub(super) fn at(self, depths: &F32x16) -> Self {
        Self { depth: S::F::load(depths), ..self }
    }
}

/// A camera's rays. Their lengths are kept: they are the same in every picture of cameras of the same make.
pub(super) struct Rays {
    side: usize,
    focal_px: f32,
    /// x and y of d at the image's middle.
    middle: [f32; 2],
    per_length: Vec<F32x16>,
}

/// Makes rays a camera's.
pub(super) struct Aim<'a> {
    pub(super) rays: &'a mut Rays,
    pub(super) camera: &'a PinholeCamera,
}

impl Kernel for Aim<'_> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self { rays, camera } = self;
        (rays.side, rays.focal_px, rays.middle) = (camera.side, camera.focal_px, camera.image_centre);
        rays.per_length.clear();
        let per_row = camera.side >> Square::WIDTH_BITS;
        for block in 0..per_row * per_row {
            let (column, row) = (block % per_row, block / per_row);
            let first = [(column << Square::WIDTH_BITS) as f32, (row << Square::HEIGHT_BITS) as f32];
            let mut line = F32x16::ZERO;
            per_length::<S>(rays.d::<S>(rays.pixel::<S>(first))).store(&mut line);
            rays.per_length.push(line);
        }
    }
}

impl Rays {
    /// Of no camera yet.
    pub(super) fn new() -> Self {
        Self { side: 0, focal_px: 0.0, middle: [0.0; 2], per_length: Vec::with_capacity(MAX_BLOCKS) }
    }

    /// Whether these are the camera's.
    pub(super) fn are_of(&self, camera: &PinholeCamera) -> bool {
        let bits = |focal_px: f32, [x, y]: [f32; 2]| [focal_px, x, y].map(f32::to_bits);
        self.side == camera.side
            && bits(self.focal_px, self.middle) == bits(camera.focal_px, camera.image_centre)
    }

    /// Rays of a block, by its column and row; what they see is 1 m deep until it is said otherwise.
    #[inline(always)]
    pub(super) fn gaze<S: Simd>(&self, column: usize, row: usize) -> Gaze<S> {
        let per_row = self.side >> Square::WIDTH_BITS;
        let first = [(column << Square::WIDTH_BITS) as f32, (row << Square::HEIGHT_BITS) as f32];
        let pixel = self.pixel::<S>(first);
        Gaze {
            pixel,
            d: self.d::<S>(pixel),
            per_length: S::F::load(&self.per_length[row * per_row + column]),
            depth: S::F::splat(1.0),
        }
    }

    /// Rays through any pixels: the same as in their blocks.
    #[inline(always)]
    pub(super) fn through<S: Simd>(&self, pixel: [S::F; 2], depth: S::F) -> Gaze<S> {
        let d = self.d::<S>(pixel);
        Gaze { pixel, d, per_length: per_length::<S>(d), depth }
    }

    /// x and y of d at the corners of a row of `n` blocks.
    #[inline(always)]
    pub(super) fn corners(&self, column: usize, row: usize, n: usize) -> [[f32; 2]; 4] {
        let per_focal = 1.0 / self.focal_px;
        let d = |pixel: usize, k: usize| {
            (pixel as f32 + 0.5 - self.side as f32 / 2.0) * per_focal + self.middle[k]
        };
        let (left, top) = (column << Square::WIDTH_BITS, row << Square::HEIGHT_BITS);
        let (right, bottom) = (left + (n << Square::WIDTH_BITS), top + Square::HEIGHT as usize);
        let [left, right] = [d(left, 0), d(right, 0)];
        let [top, bottom] = [d(top, 1), d(bottom, 1)];
        [[left, top], [right, top], [left, bottom], [right, bottom]]
    }

    /// Columns and rows of the same lane's pixel in the sixteen blocks of a strip, by the first block's column and row.
    #[inline(always)]
    pub(super) fn pixels_of_strip<S: Simd>([column, row]: [usize; 2], lane: usize) -> [S::F; 2] {
        let [right, down] = Square::PLACES[lane];
        let x = ((column << Square::WIDTH_BITS) as i32 + right) as f32;
        let y = ((row << Square::HEIGHT_BITS) as i32 + down) as f32;
        [S::F::splat(x) + S::F::load(&BLOCK_STARTS), S::F::splat(y)]
    }

    /// Columns and rows of the pixels of a block with this first one.
    #[inline(always)]
    fn pixel<S: Simd>(&self, [x, y]: [f32; 2]) -> [S::F; 2] {
        [S::F::splat(x) + S::F::load(&Square::X_FLOATS), S::F::splat(y) + S::F::load(&Square::Y_FLOATS)]
    }

    #[inline(always)]
    fn d<S: Simd>(&self, pixel: [S::F; 2]) -> [S::F; 2] {
        let per_focal = 1.0 / self.focal_px;
        let first = (0.5 - self.side as f32 / 2.0) * per_focal;
        each!(k in 2 => pixel[k].mul_add(S::F::splat(per_focal), S::F::splat(first + self.middle[k])))
    }
}

#[inline(always)]
fn per_length<S: Simd>([x, y]: [S::F; 2]) -> S::F {
    S::F::splat(1.0) / x.mul_add(x, y.mul_add(y, S::F::splat(1.0))).sqrt()
}

/// Columns of the first pixels of a strip's blocks.
const BLOCK_STARTS: F32x16 = {
    let mut line = F32x16::ZERO;
    let mut i = 0;
    while i < N_LANES {
        line.0[i] = (i << Square::WIDTH_BITS) as f32;
        i += 1;
    }
    line
};
