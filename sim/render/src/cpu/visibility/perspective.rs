//! The rules of the perspective projection: culling, and clipping of what is near or far outside.

use super::clip;
use super::projection::{ClipFlags, PinholeProjection, Projected, ScreenProjection, Vectors};
use super::raster::Visibility;
use super::tile::TileLayout;
use crate::cpu::simd::each::each;
use crate::cpu::simd::{FloatLike, Simd, SimdF32, SimdMask};
use crate::math::affine::{Affine3, Vec3};
use crate::mesh::ClusterBounds;
use crate::prepared::Instance;

impl ScreenProjection for PinholeProjection {
    fn includes(&self, _instance: &Instance) -> bool {
        true
    }

    #[inline(always)]
    fn begin_mesh(&mut self, view_from_mesh: &Affine3, centre: Vec3, radius: f32) -> bool {
        self.eye_in_mesh = view_from_mesh.preimage_of_origin();
        let [x, y, z] = view_from_mesh.transform_point(centre);
        let radius = radius * view_from_mesh.max_scale();
        z + radius >= self.near_m
            && z - radius <= self.far_m
            && x.abs() - self.slopes[0] * z <= radius * self.sphere_margins[0]
            && y.abs() - self.slopes[1] * z <= radius * self.sphere_margins[1]
    }

    #[inline(always)]
    fn project<S: Simd>(&self, [x, y, z]: &Vectors<S>) -> Projected<S> {
        let depth = S::F::splat(1.0) / *z;
        let scale = S::F::splat(self.focal_px * 256.0);
        let [column, row] = each!(k in 2 => S::F::splat(self.half_px[k] * 256.0));
        Projected {
            x: (*x * depth).mul_add(scale, column).round_to_i32(),
            y: (*y * depth).mul_add(scale, row).round_to_i32(),
            depth,
        }
    }

    #[inline(always)]
    fn needs_clip<S: Simd>(&self, [x, y, z]: &Vectors<S>) -> ClipFlags<S> {
        let behind_near = S::F::splat(self.near_m).gt(*z);
        let [right, bottom] = each!(k in 2 => *z * S::F::splat(self.guard_slopes[k]));
        let [left, top] = each!(k in 2 => *z * S::F::splat(-self.guard_slopes[k]));
        let needs_clip = behind_near | x.gt(right) | left.gt(*x) | y.gt(bottom) | top.gt(*y);
        ClipFlags { behind_near, needs_clip }
    }

    #[inline(always)]
    fn cull_clusters<S: Simd>(&self, bounds: &ClusterBounds, [x, y, z]: &Vectors<S>, radius: S::F) -> u16 {
        let [right, bottom] = each!(k in 2 =>
            z.mul_add(S::F::splat(self.slopes[k]), radius * S::F::splat(self.sphere_margins[k])));
        let zero = S::F::splat(0.0);
        let outside = S::F::splat(self.near_m).gt(*z + radius)
            | (*z - radius).gt(S::F::splat(self.far_m))
            | x.gt(right)
            | (zero - *x).gt(right)
            | y.gt(bottom)
            | (zero - *y).gt(bottom);
        let [a, b, c] = each!(k in 3 => S::F::load(&bounds.centre[k]) - S::F::splat(self.eye_in_mesh[k]));
        let distance = c.mul_add(c, b.mul_add(b, a * a)).sqrt();
        let [l, m, n] = each!(k in 3 => S::F::load(&bounds.axis[k]));
        let along = c.mul_add(n, b.mul_add(m, a * l));
        let back_facing = along.gt(distance.mul_add(S::F::load(&bounds.cutoff), S::F::load(&bounds.radius)));
        (outside | back_facing).to_bits()
    }

    #[inline(always)]
    fn clip<S: Simd, B: TileLayout>(&self, triangle: [Vec3; 3], id: i32, visibility: &mut Visibility) {
        clip::draw::<S, B>(triangle, self, id, visibility);
    }
}
