//! Shadows of the first sun: a map of heights along its light, and looking up whether a point is reached.

use core::marker::PhantomData;

use super::each::each;
use super::geometry::Draw;
use super::isa::Isa;
use super::kind::{Block, Row};
use super::lens::{Lens, Projected, Unfit, Vectors};
use super::raster::Visibility;
use super::rays::Gaze;
use super::simd::{Floats, Mask, Number, Per, Simd, Whole, WholeLine};
use crate::render::affine::{Affine, Vec3, normalised, scaled};
use crate::render::mesh::Bounds;
use crate::render::posed;
use crate::render::rules::{MAP_M, MAP_SIDE, OFF_SURFACE_M, light_from_world};
use crate::render::scene::{Instance, RenderScene};
use crate::scene::Snapshot;

/// Texels along each edge of a map.
const SIDE: usize = MAP_SIDE as usize;
const TEXELS_PER_M: f32 = SIDE as f32 / MAP_M;
/// Nothing is as low as this, in m.
const DEPTHS_OF_SPACE: f32 = -1e9;

/// Heights along the first sun's light, in m, of the surfaces that look away from it: those that look at it would now and
/// then shade themselves.
pub(super) struct ShadowMap {
    heights: Visibility,
    light_from_world: Affine,
    maps: Vec<Affine>,
}

impl ShadowMap {
    /// No map yet, and room for one.
    pub(super) fn new() -> Self {
        let mut heights = Visibility::new();
        heights.clear::<Row>(SIDE, DEPTHS_OF_SPACE);
        Self { heights, light_from_world: Affine::IDENTITY, maps: Vec::with_capacity(256) }
    }

    /// Draws everything that casts a shadow in a scene that has shadows.
    pub(super) fn draw(&mut self, isa: Isa, scene: &RenderScene, snapshot: &Snapshot) {
        let Some(centre) = scene.shadow_centre else { return };
        self.light_from_world = mirrored(light_from_world(scene.suns[0].towards, centre));
        posed::pose(scene, snapshot, &self.light_from_world, &mut self.maps);
        self.heights.clear::<Row>(SIDE, DEPTHS_OF_SPACE);
        isa.run(Draw {
            instances: &scene.instances,
            maps: &self.maps,
            first_ids: &scene.first_id,
            lens: Parallel { light_in_mesh: [0.0; 3] },
            visibility: &mut self.heights,
            blocks: PhantomData::<Row>,
        });
    }

    /// What a camera needs to look points up.
    pub(super) fn seen_from(&self, view_from_world: &Affine) -> Shadow<'_> {
        let mut texel_from_view = self.light_from_world.after(&view_from_world.rigid_inverse());
        for axis in 0..2 {
            texel_from_view.linear[axis] = scaled(texel_from_view.linear[axis], TEXELS_PER_M);
            // From texels' corners to their middles.
            texel_from_view.offset[axis] =
                texel_from_view.offset[axis] * TEXELS_PER_M + (SIDE as f32 / 2.0 - 0.5);
        }
        Shadow { heights: bytemuck::cast_slice(&self.heights.depths), texel_from_view }
    }
}

/// The light's frame upside down: a mirror image of what the sun sees, so that what looks away from it is drawn.
fn mirrored(light_from_world: Affine) -> Affine {
    let Affine { linear: [right, down, height], offset: [x, y, z] } = light_from_world;
    Affine { linear: [right, scaled(down, -1.0), height], offset: [x, -y, z] }
}

/// A shadow map as a camera looks it up.
pub(super) struct Shadow<'a> {
    /// `[512, 512]` bits of f32 heights in m.
    heights: &'a [u32],
    /// From the view frame to texels and heights.
    texel_from_view: Affine,
}

impl Shadow<'_> {
    /// What share of the sun's light reaches what is seen, given its unit normals.
    #[inline(always)]
    pub(super) fn sunlight<S: Simd, N: Per<S>>(&self, gaze: &Gaze<S>, normal: &[N; 3]) -> S::F {
        let z = S::F::all(1.0) / gaze.depth;
        let [dx, dy] = gaze.d;
        let [x, y, height] = each!(i in 3 => {
            let [a, b, c] = self.texel_from_view.linear[i];
            let along = dx.mul_add(S::F::all(a), dy.mul_add(S::F::all(b), S::F::all(c)));
            let aside = normal[0].mul_add(N::all(a), normal[1].mul_add(N::all(b), normal[2] * N::all(c)));
            let offset = aside.mul_add(N::all(OFF_SURFACE_M), N::all(self.texel_from_view.offset[i]));
            z.mul_add(along, offset.spread())
        });
        let (zero, last) = (S::F::all(0.0), S::F::all((SIDE - 1) as f32));
        let outside = zero.gt(x) | x.gt(last) | zero.gt(y) | y.gt(last);
        if outside.to_bits() == u16::MAX {
            return S::F::all(1.0);
        }
        let limit = S::F::all((SIDE - 2) as f32);
        let (column, row) = (x.max(zero).min(limit).truncated(), y.max(zero).min(limit).truncated());
        let (fx, fy) = (x - column.floats(), y - row.floats());
        let mut place = WholeLine::ZERO;
        (row.shl::<9>() + column).store(&mut place);
        let (a, b) = S::pairs(self.heights, &place);
        let (c, d) = S::pairs(&self.heights[SIDE..], &place);
        let corners = [a, b, c, d];
        let [a, b, c, d] = each!(k in 4 => {
            let shaded = corners[k].as_float_bits().gt(height);
            S::F::all(0.0).or_where(shaded, S::F::all(1.0))
        });
        let upper = (b - a).mul_add(fx, a);
        let lower = (d - c).mul_add(fx, c);
        S::F::all(1.0).or_where(outside, (lower - upper).mul_add(fy, upper))
    }
}

/// The view along the light.
struct Parallel {
    /// Direction to the light in the frame of the mesh that is drawn.
    light_in_mesh: Vec3,
}

/// Texels beyond the map's edges that fit the rasteriser's numbers; nothing in a scene reaches farther, but for the floor.
const GUARD: f32 = 512.0;

impl Lens for Parallel {
    fn draws(&self, instance: &Instance) -> bool {
        instance.casts_shadow()
    }

    fn turn_to(&mut self, light_from_mesh: &Affine, centre: Vec3, radius: f32) -> bool {
        // Facing is kept by cofactors: n' · z' = (C n) · z' = n · (Cᵀ z').
        self.light_in_mesh = normalised(light_from_mesh.normals()[2]);
        let [x, y, _] = light_from_mesh.point(centre);
        let reach = MAP_M / 2.0 + radius * light_from_mesh.stretch();
        x.abs() <= reach && y.abs() <= reach
    }

    #[inline(always)]
    fn project<S: Simd>(&self, [x, y, z]: &Vectors<S>) -> Projected<S> {
        let (scale, middle) = (S::F::all(TEXELS_PER_M * 256.0), S::F::all((SIDE * 128) as f32));
        Projected { x: x.mul_add(scale, middle).rounded(), y: y.mul_add(scale, middle).rounded(), depth: *z }
    }

    #[inline(always)]
    fn unfit<S: Simd>(&self, [x, y, _]: &Vectors<S>) -> Unfit<S> {
        let reach = S::F::all((SIDE as f32 / 2.0 + GUARD) / TEXELS_PER_M);
        let opposite = S::F::all(0.0) - reach;
        let far = x.gt(reach) | opposite.gt(*x) | y.gt(reach) | opposite.gt(*y);
        Unfit { hidden: far, unfit: far }
    }

    #[inline(always)]
    fn misses<S: Simd>(&self, bounds: &Bounds, [x, y, _]: &Vectors<S>, radius: S::F) -> u16 {
        let reach = radius + S::F::all(MAP_M / 2.0);
        let opposite = S::F::all(0.0) - reach;
        let outside = x.gt(reach) | opposite.gt(*x) | y.gt(reach) | opposite.gt(*y);
        // A cluster all of whose normals are within 90° of the light's direction has no back face.
        let [l, m, n] = each!(k in 3 => S::F::load(&bounds.axis[k]) * S::F::all(self.light_in_mesh[k]));
        let facing = (l + m + n).gt(S::F::load(&bounds.cutoff));
        (outside | facing).to_bits()
    }

    #[inline(always)]
    fn clip<S: Simd, B: Block>(&self, _triangle: [Vec3; 3], _id: i32, _visibility: &mut Visibility) {}
}
