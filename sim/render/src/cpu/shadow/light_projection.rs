//! Orthographic projection along the first directional light.

use super::size::{MIDDLE_STEPS, SIDE, STEPS_PER_M, TEXELS_PER_M};
use crate::cpu::simd::each::each;
use crate::cpu::simd::{FloatLike, Simd, SimdF32, SimdMask};
use crate::cpu::visibility::projection::{ClipFlags, Projected, ScreenProjection, Vectors};
use crate::cpu::visibility::raster::Visibility;
use crate::cpu::visibility::tile::TileLayout;
use crate::math::affine::{Affine3, Vec3, normalised};
use crate::mesh::ClusterBounds;
use crate::prepared::Instance;
use crate::shading::SHADOW_MAP_WIDTH_M;

/// The projection onto the shadow map.
pub(crate) struct LightProjection {
    /// Direction to the light in the frame of the current mesh.
    pub(crate) light_in_mesh: Vec3,
}

/// Width of the guard band in texels. Only the floor extends further, and it casts no shadow.
const GUARD: f32 = 512.0;

impl ScreenProjection for LightProjection {
    fn includes(&self, instance: &Instance) -> bool {
        instance.casts_shadow()
    }

    fn begin_mesh(&mut self, light_from_mesh: &Affine3, centre: Vec3, radius: f32) -> bool {
        // Normals transform by cofactors: n' · z' = (C n) · z' = n · (Cᵀ z').
        self.light_in_mesh = normalised(light_from_mesh.cofactors()[2]);
        let [x, y, _] = light_from_mesh.transform_point(centre);
        let reach = SHADOW_MAP_WIDTH_M / 2.0 + radius * light_from_mesh.max_scale();
        x.abs() <= reach && y.abs() <= reach
    }

    #[inline(always)]
    fn project<S: Simd>(&self, [x, y, z]: &Vectors<S>) -> Projected<S> {
        let (scale, middle) = (S::F::splat(TEXELS_PER_M * 256.0), S::F::splat((SIDE * 128) as f32));
        Projected {
            x: x.mul_add(scale, middle).round_to_i32(),
            y: y.mul_add(scale, middle).round_to_i32(),
            depth: z.mul_add(S::F::splat(STEPS_PER_M), S::F::splat(MIDDLE_STEPS)),
        }
    }

    #[inline(always)]
    fn needs_clip<S: Simd>(&self, [x, y, _]: &Vectors<S>) -> ClipFlags<S> {
        let reach = S::F::splat((SIDE as f32 / 2.0 + GUARD) / TEXELS_PER_M);
        let opposite = S::F::splat(0.0) - reach;
        let far = x.gt(reach) | opposite.gt(*x) | y.gt(reach) | opposite.gt(*y);
        ClipFlags { behind_near: far, needs_clip: far }
    }

    #[inline(always)]
    fn cull_clusters<S: Simd>(&self, bounds: &ClusterBounds, [x, y, _]: &Vectors<S>, radius: S::F) -> u16 {
        let reach = radius + S::F::splat(SHADOW_MAP_WIDTH_M / 2.0);
        let opposite = S::F::splat(0.0) - reach;
        let outside = x.gt(reach) | opposite.gt(*x) | y.gt(reach) | opposite.gt(*y);
        // Only back faces cast shadows. A cluster whose normals all lie within 90° of the light has none.
        let [l, m, n] = each!(k in 3 => S::F::load(&bounds.axis[k]) * S::F::splat(self.light_in_mesh[k]));
        let facing = (l + m + n).gt(S::F::load(&bounds.cutoff));
        (outside | facing).to_bits()
    }

    #[inline(always)]
    fn clip<S: Simd, B: TileLayout>(&self, _triangle: [Vec3; 3], _id: i32, _visibility: &mut Visibility) {}
}
