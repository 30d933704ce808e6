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

impl ScreenProjection for PinholeProjection<'_> {
    fn includes(&self, _instance: &Instance) -> bool {
        true
    }

    #[inline(always)]
    fn begin_mesh(&mut self, view_from_mesh: &Affine3, centre: Vec3, radius: f32) -> bool {
        self.eye_in_mesh = view_from_mesh.preimage_of_origin();
        self.camera.may_intersect_sphere(view_from_mesh, centre, radius)
    }

    #[inline(always)]
    fn project<S: Simd>(&self, [x, y, z]: &Vectors<S>) -> Projected<S> {
        let depth = S::F::splat(1.0) / *z;
        let (scale, middle) = (S::F::splat(self.focal_px * 256.0), S::F::splat(self.half_px * 256.0));
        Projected {
            x: (*x * depth).mul_add(scale, middle).round_to_i32(),
            y: (*y * depth).mul_add(scale, middle).round_to_i32(),
            depth,
        }
    }

    #[inline(always)]
    fn needs_clip<S: Simd>(&self, [x, y, z]: &Vectors<S>) -> ClipFlags<S> {
        let behind_near = S::F::splat(self.near_m).gt(*z);
        let guard = *z * S::F::splat(self.guard_slope);
        let opposite = *z * S::F::splat(-self.guard_slope);
        let needs_clip = behind_near | x.gt(guard) | opposite.gt(*x) | y.gt(guard) | opposite.gt(*y);
        ClipFlags { behind_near, needs_clip }
    }

    #[inline(always)]
    fn cull_clusters<S: Simd>(&self, bounds: &ClusterBounds, [x, y, z]: &Vectors<S>, radius: S::F) -> u16 {
        let slack = radius * S::F::splat(self.sphere_margin);
        let edge = z.mul_add(S::F::splat(self.slope), slack);
        let zero = S::F::splat(0.0);
        let outside = S::F::splat(self.near_m).gt(*z + radius)
            | (*z - radius).gt(S::F::splat(self.far_m))
            | x.gt(edge)
            | (zero - *x).gt(edge)
            | y.gt(edge)
            | (zero - *y).gt(edge);
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
