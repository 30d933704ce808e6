//! Shadow map lookups: the fraction of the light that reaches each pixel of a tile, and conservative bounds
//! of where a tile is looked up.

use super::max_heights::{MaxHeightPyramid, PyramidLevel, PyramidWindow};
use super::size::{MAX_HEIGHT, SIDE, STEPS_PER_M, TEXELS_PER_M};
use crate::cpu::shading::rays::{RayTable, ViewRays};
use crate::cpu::simd::each::each;
use crate::cpu::simd::{Broadcast, F32x16, FloatLike, I32x16, SetBits, Simd, SimdF32, SimdI32, SimdMask};
use crate::cpu::visibility::tile::Tile4x4;
use crate::math::affine::Affine3;
use crate::shading::SHADOW_NORMAL_OFFSET_M;

/// Tolerance for rounding when heights are compared with maximum heights, in steps.
const SLACK_STEPS: f32 = 4.0;

/// A shadow map with the transform from a camera's view frame.
pub(crate) struct Shadow<'a> {
    /// `[512, 512]` heights in steps.
    pub(crate) heights: &'a [u16],
    /// Maximum heights of moving and of static geometry.
    pub(crate) max_heights: [&'a MaxHeightPyramid; 2],
    /// Transform from the view frame to texels and height steps.
    pub(crate) texel_from_view: Affine3,
}

impl Shadow<'_> {
    /// Returns the fraction of the light that reaches the visible points, given their unit normals:
    /// percentage-closer filtering of 2 × 2 texels. Unspecified where `facing` is not set.
    #[inline(always)]
    pub(crate) fn sunlight<S: Simd, N: Broadcast<S>>(
        &self,
        ray: &ViewRays<S>,
        normal: &[N; 3],
        facing: S::M,
    ) -> S::F {
        let [x, y, height] = self.lookup_position(ray, normal);
        let (zero, last) = (S::F::splat(0.0), S::F::splat((SIDE - 1) as f32));
        let outside = zero.gt(x) | x.gt(last) | zero.gt(y) | y.gt(last);
        let mut at = [clamp_to_map::<S>(x), clamp_to_map::<S>(y)];
        // Move the lookups of pixels that do not face the light to those of others, so that the window stays
        // small.
        let both = at[0] | at[1].shl::<16>();
        let min = both.select_or(facing, S::I::splat(-1)).reduce_min_u16();
        let first = each!(k in 2 => i32::from(min[k]));
        at = each!(k in 2 => at[k].select_or(facing, S::I::splat(first[k])));
        let [fx, fy] = each!(k in 2 => [x, y][k] - at[k].to_f32());
        let corner = each!(k in 2 => first[k].min((SIDE - 8) as i32));
        let within = each!(k in 2 => at[k] - S::I::splat(corner[k]));
        let first = corner[1] as usize * SIDE + corner[0] as usize;
        let rows = match S::gather_window_u16(self.heights, first, SIDE, within) {
            Some(rows) => rows,
            None => {
                let mut place = I32x16::ZERO;
                (at[1].shl::<9>() + at[0]).store(&mut place);
                [
                    S::gather_neighbours_u16(self.heights, &place),
                    S::gather_neighbours_u16(&self.heights[SIDE..], &place),
                ]
            }
        };
        let height = height.max(S::F::splat(0.0)).min(S::F::splat(MAX_HEIGHT)).truncate_to_i32();
        let share = |there: S::I| S::F::splat(0.0).select_or(there.gt(height), S::F::splat(1.0));
        let [[a, b], [c, d]] =
            each!(k in 2 => [share(rows[k] & S::I::splat(0xFFFF)), share(rows[k].shr_logical::<16>())]);
        let upper = (b - a).mul_add(fx, a);
        let lower = (d - c).mul_add(fx, c);
        S::F::splat(1.0).select_or(outside, (lower - upper).mul_add(fy, upper))
    }

    /// Returns the tiles of a tile row that are fully lit as far as the maximum heights can tell; bit i
    /// stands for tile i. The `tiles`, at least one, all show the same plane with this unit normal, at these
    /// depths.
    #[inline(always)]
    pub(crate) fn fully_lit_tiles<S: Simd>(
        &self,
        rays: &RayTable,
        [column, row]: [usize; 2],
        depths: &[F32x16],
        tiles: u16,
        normal: &[f32; 3],
    ) -> u16 {
        // Tolerance for rounding, in texels.
        const SLACK: f32 = 0.05;
        let first = tiles.trailing_zeros() as usize;
        let last = tiles.checked_ilog2().map_or(first, |last| last as usize);
        // Position of each tile between the first (0) and the last (1).
        let per_block = 1.0 / (last - first).max(1) as f32;
        let far =
            (S::I::load(&I32x16::INDICES) - S::I::splat(first as i32)).to_f32() * S::F::splat(per_block);
        // The projection of a plane preserves convexity: the pixels of a tile map into the hull of its
        // corners.
        let corners = each!(k in 4 => {
            let lane = Tile4x4::CORNERS[k];
            let [from, to] = [depths[first].0[lane], depths[last].0[lane]];
            let depth = far.mul_add(S::F::splat(to - from), S::F::splat(from));
            let pixel = RayTable::pixels_of_tile_row::<S>([column, row], lane);
            self.lookup_position(&rays.for_pixels::<S>(pixel, depth), normal)
        });
        let min = each!(i in 3 => corners[0][i].min(corners[1][i]).min(corners[2][i].min(corners[3][i])));
        let max = each!(i in 2 => corners[0][i].max(corners[1][i]).max(corners[2][i].max(corners[3][i])));
        let from = each!(k in 2 => clamp_to_map::<S>(min[k] - S::F::splat(SLACK)));
        // Including the neighbours that filtering reads.
        let to = each!(k in 2 => clamp_to_map::<S>(max[k] + S::F::splat(SLACK)) + S::I::splat(1));
        let size = (to[0] - from[0]).max(to[1] - from[1]);
        let max_size = size.select_or(S::M::from_bits(tiles), S::I::splat(0)).reduce_max();
        let Some(level) = PyramidLevel::of(max_size) else { return 0 };
        let mut windows = I32x16::ZERO;
        level.windows::<S>(from).store(&mut windows);
        let mut heights = I32x16::ZERO;
        for tile in SetBits(tiles) {
            let window = PyramidWindow(windows.0[tile]);
            heights.0[tile] =
                self.max_heights[0].within(window).max(self.max_heights[1].within(window)).into();
        }
        (min[2] - S::F::splat(SLACK_STEPS)).gt(S::I::load(&heights).to_f32()).to_bits() & tiles
    }

    /// Returns the lookup position in texels and the height of the visible points, given their unit normals.
    #[inline(always)]
    fn lookup_position<S: Simd, N: Broadcast<S>>(&self, ray: &ViewRays<S>, normal: &[N; 3]) -> [S::F; 3] {
        let z = S::F::splat(1.0) / ray.depth;
        let [dx, dy] = ray.d;
        each!(i in 3 => {
            let [a, b, c] = self.texel_from_view.linear[i];
            let along = dx.mul_add(S::F::splat(a), dy.mul_add(S::F::splat(b), S::F::splat(c)));
            let aside = normal[0].mul_add(N::splat(a), normal[1].mul_add(N::splat(b), normal[2] * N::splat(c)));
            let offset = aside.mul_add(N::splat(SHADOW_NORMAL_OFFSET_M), N::splat(self.texel_from_view.offset[i]));
            z.mul_add(along, offset.broadcast())
        })
    }
}

/// Returns the texel whose centre is at or before a coordinate, clamped so that it has a right neighbour on
/// the map.
#[inline(always)]
fn clamp_to_map<S: Simd>(x: S::F) -> S::I {
    x.max(S::F::splat(0.0)).min(S::F::splat((SIDE - 2) as f32)).truncate_to_i32()
}

/// Accumulates bounds of the lookups of a tile, for any normals.
pub(crate) struct LightBoundsBuilder {
    /// First and last column, first and last row; `None` if there are no lookups.
    texels: Option<[[i32; 2]; 2]>,
    /// Minimum height: lower geometry cannot shade the tile.
    min_height: f32,
}

impl LightBoundsBuilder {
    /// Bounds of nothing.
    pub(crate) const NONE: Self = Self { texels: None, min_height: f32::INFINITY };

    /// Adds the visible points of a tile where `visible` is set.
    #[inline(always)]
    pub(crate) fn add<S: Simd>(&mut self, shadow: &Shadow<'_>, ray: &ViewRays<S>, visible: S::M) {
        // Normals are unit vectors; the rest is tolerance for rounding.
        const SLACK: f32 = SHADOW_NORMAL_OFFSET_M * TEXELS_PER_M + 0.1;
        const LAST: i32 = SIDE as i32 - 2;
        let mut lanes = [F32x16::ZERO; 3];
        let position = shadow.lookup_position(ray, &[0.0; 3]);
        for k in 0..3 {
            position[k].store(&mut lanes[k]);
        }
        let [columns, rows, heights] = &lanes;
        for lane in SetBits(visible.to_bits()) {
            let (at, height) = ([columns.0[lane], rows.0[lane]], heights.0[lane]);
            if at.iter().any(|x| !(-SLACK..SIDE as f32 + SLACK).contains(x)) {
                continue;
            }
            // Including the neighbour that filtering reads.
            let texels = at.map(|x| {
                let (first, last) = ((x - SLACK) as i32, (x + SLACK) as i32);
                [first.clamp(0, LAST), last.clamp(0, LAST) + 1]
            });
            self.texels = Some(match self.texels {
                None => texels,
                Some(known) => {
                    each!(k in 2 => [known[k][0].min(texels[k][0]), known[k][1].max(texels[k][1])])
                }
            });
            self.min_height =
                self.min_height.min(height - (SHADOW_NORMAL_OFFSET_M * STEPS_PER_M + SLACK_STEPS));
        }
    }

    /// Returns the bounds.
    pub(crate) fn finish(&self) -> LightBounds {
        LightBounds { window: self.texels.and_then(PyramidWindow::around), min_height: self.min_height }
    }
}

/// Conservative bounds, on the shadow map, of the geometry that can shade a tile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LightBounds {
    /// Window of the lookups; `None` if they span more than the largest window.
    window: Option<PyramidWindow>,
    /// Minimum height: lower geometry cannot shade the tile.
    min_height: f32,
}

impl LightBounds {
    /// Returns `true` if geometry with these maximum heights may shade the tile.
    #[inline(always)]
    pub(crate) fn may_be_shaded_by(&self, max_heights: &MaxHeightPyramid) -> bool {
        match self.window {
            Some(window) => f32::from(max_heights.within(window)) > self.min_height,
            None => self.min_height < f32::INFINITY,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{MaxHeightPyramid, RayTable, SIDE, STEPS_PER_M, Shadow, TEXELS_PER_M, Tile4x4};
    use crate::cpu::shading::rays::ComputeRayTable;
    use crate::cpu::shadow::size::{CELL, CELLS};
    use crate::cpu::simd::isa::Isa;
    use crate::cpu::simd::{F32x16, FloatLike, N_LANES, Portable, Simd, SimdF32, SimdMask};
    use crate::math::affine::{Affine3, dot, normalised, scaled};
    use crate::prepared::camera::PinholeCamera;
    use ipc_types::ImageSizes;
    use scene::stream::Stream;
    use sim::{Profile, TaskId};

    type MaskX16 = <Portable as Simd>::M;
    type F32Lanes = <Portable as Simd>::F;

    /// Creates a map of random boxes about as high as the lookups, and its maximum heights.
    fn map(stream: &mut Stream) -> (Vec<u16>, MaxHeightPyramid) {
        let mut heights = vec![0; SIDE * SIDE];
        for _ in 0..200 {
            let mut below = |n: usize| (stream.unit() * n as f64) as usize;
            let (left, top, width, height) = (below(SIDE), below(SIDE), below(40), below(40));
            let step = 28_000 + below(8_000) as u16;
            for row in top..(top + height).min(SIDE) {
                heights[row * SIDE..][left..(left + width).min(SIDE)].fill(step);
            }
        }
        let mut max_heights = MaxHeightPyramid::new();
        for place in (0..CELLS * CELLS).step_by(2) {
            let [column, row] = [place % CELLS, place / CELLS];
            let cell = |column: usize| {
                let texels =
                    (0..CELL).flat_map(|y| &heights[(row * CELL + y) * SIDE..][column * CELL..][..CELL]);
                texels.copied().max().unwrap()
            };
            max_heights.set_cell_pair([column, row], [cell(column), cell(column + 1)]);
        }
        max_heights.finish(Some([[0, CELLS - 1]; 2]));
        (heights, max_heights)
    }

    #[test]
    fn fully_lit_tiles_are_lit_at_every_pixel() {
        let mut stream = Stream::new(3, "sunlight");
        let scene = (TaskId::RaiseCube.task().nominal)(Profile::Strict).draw(1);
        let (camera, mut rays) =
            (PinholeCamera::new(&scene.cameras[0], ImageSizes::BENCHMARK), RayTable::new());
        Isa::Portable.run(ComputeRayTable { rays: &mut rays, camera: &camera });
        let [per_row, _] = Tile4x4::cover(camera.size);
        let (heights, max_heights) = map(&mut stream);
        let nothing = MaxHeightPyramid::new();
        let [mut n_reported, mut n_sunlit, mut n_shaded] = [0; 3];
        for _ in 0..600 {
            let mut random = |min: f64, max: f64| (min + stream.unit() * (max - min)) as f32;
            // The light comes from above and the side; the plane has a random orientation towards the camera.
            let (sin, cos) = libm::sincosf(random(0.2, 1.3));
            let texel_from_view = Affine3 {
                linear: [
                    scaled([1.0, 0.0, 0.0], TEXELS_PER_M),
                    scaled([0.0, cos, sin], TEXELS_PER_M),
                    scaled([0.0, -sin, cos], -STEPS_PER_M),
                ],
                offset: [256.0, random(0.0, 256.0), random(32_000.0, 40_000.0)],
            };
            let shadow = Shadow { heights: &heights, max_heights: [&max_heights, &nothing], texel_from_view };
            let normal = normalised([random(-1.0, 1.0), random(-1.0, 1.0), random(-1.0, -0.3)]);
            let distance = random(0.5, 2.0);
            let n = 1 + (random(0.0, 0.999) * 16.0) as usize;
            let [column, row] =
                [per_row - n, per_row - 1].map(|last| (random(0.0, 0.999) * last as f32) as usize);
            let depths: Vec<F32x16> = (0..n)
                .map(|i| {
                    let mut lines = [F32x16::ZERO; 2];
                    let ray = rays.tile::<Portable>(column + i, row);
                    ray.d[0].store(&mut lines[0]);
                    ray.d[1].store(&mut lines[1]);
                    F32x16(core::array::from_fn(|lane| {
                        -dot(normal, [lines[0].0[lane], lines[1].0[lane], 1.0]) / distance
                    }))
                })
                .collect();
            // Skip planes that extend behind the camera.
            if depths.iter().flat_map(|line| line.0).any(|depth| depth < 0.1) {
                continue;
            }
            let all = (u32::from(u16::MAX) >> (N_LANES - n)) as u16;
            let tiles = all & ((stream.unit() * 65536.0) as u16 | 1 << (n - 1));
            let reported = shadow.fully_lit_tiles::<Portable>(&rays, [column, row], &depths, tiles, &normal);
            assert_eq!(reported & !tiles, 0);
            for (i, depths) in depths.iter().enumerate().filter(|(i, _)| tiles >> i & 1 == 1) {
                let ray = rays.tile::<Portable>(column + i, row).at(depths);
                let share = shadow.sunlight::<Portable, f32>(&ray, &normal, MaskX16::from_bits(u16::MAX));
                let is_sunlit = !F32Lanes::splat(1.0).gt(share).any();
                let is_reported = reported >> i & 1 == 1;
                assert!(is_sunlit || !is_reported, "tile {i} of {tiles:b} at {column}, {row}");
                n_reported += u32::from(is_reported);
                n_sunlit += u32::from(is_sunlit);
                n_shaded += u32::from(!is_sunlit);
            }
        }
        assert!(
            n_shaded > 200 && n_reported > 200 && 2 * n_reported > n_sunlit,
            "{n_shaded}, {n_reported} of {n_sunlit}"
        );
    }
}
