//! Projections from the view frame to the image: perspective for cameras, orthographic along a light for
//! shadow maps.

use super::tile::TileLayout;
use crate::cpu::simd::Simd;
use crate::cpu::visibility::raster::{ScreenVertex, Visibility};
use crate::math::affine::{Affine3, Vec3};
use crate::mesh::ClusterBounds;
use crate::prepared::Instance;
use crate::prepared::camera::PinholeCamera;

/// One point or direction per lane.
pub(crate) type Vectors<S> = [<S as Simd>::F; 3];

/// Image coordinates and depths of sixteen points.
pub(crate) struct Projected<S: Simd> {
    /// Column, in 1/256 px.
    pub(crate) x: S::I,
    /// Row, in 1/256 px.
    pub(crate) y: S::I,
    /// Depth as defined in [`super::raster`].
    pub(crate) depth: S::F,
}

/// A projection with its culling and clipping rules.
pub(crate) trait ScreenProjection {
    /// Returns `true` if an instance is to be rasterised at all.
    fn includes(&self, instance: &Instance) -> bool;

    /// Prepares for the next mesh. Returns `false` if its bounding sphere, given in the mesh frame, is
    /// outside the view.
    fn begin_mesh(&mut self, view_from_mesh: &Affine3, centre: Vec3, radius: f32) -> bool;

    /// Projects sixteen points. The result is unspecified for points that need clipping.
    fn project<S: Simd>(&self, point: &Vectors<S>) -> Projected<S>;

    /// Classifies points that are invisible or exceed the range of the rasteriser's fixed-point numbers.
    fn needs_clip<S: Simd>(&self, point: &Vectors<S>) -> ClipFlags<S>;

    /// Returns the lanes of `bounds` whose clusters are invisible, given their centres and radii in the view
    /// frame.
    fn cull_clusters<S: Simd>(&self, bounds: &ClusterBounds, centre: &Vectors<S>, radius: S::F) -> u16;

    /// Clips and rasterises a triangle.
    fn clip<S: Simd, B: TileLayout>(&self, triangle: [Vec3; 3], id: i32, visibility: &mut Visibility);
}

/// Clip flags of sixteen points.
pub(crate) struct ClipFlags<S: Simd> {
    /// Set for points behind the near plane.
    pub(crate) behind_near: S::M,
    /// Set for those and for points outside the guard band.
    pub(crate) needs_clip: S::M,
}

/// The perspective projection of a camera.
pub(crate) struct PinholeProjection {
    pub(crate) focal_px: f32,
    /// Half the width and height of the image, in px.
    pub(crate) half_px: [f32; 2],
    pub(crate) near_m: f32,
    pub(crate) far_m: f32,
    /// Maximum |x/z| and |y/z| inside the image.
    pub(crate) slopes: [f32; 2],
    /// Values of [`PinholeCamera::sphere_margins`].
    pub(crate) sphere_margins: [f32; 2],
    /// Maximum |x/z| and |y/z| inside the guard band.
    pub(crate) guard_slopes: [f32; 2],
    /// Position of the camera in the mesh frame.
    pub(crate) eye_in_mesh: Vec3,
}

/// Width of the guard band: triangles that extend no further beyond the image are rasterised without
/// clipping.
const GUARD_PX: f32 = 448.0;

impl PinholeProjection {
    /// Creates the projection for a grid with `scale` samples per pixel along each edge.
    pub(crate) fn new(camera: &PinholeCamera, scale: usize) -> Self {
        let half_px = camera.half_px().map(|half_px| half_px * scale as f32);
        let focal_px = camera.focal_px * scale as f32;
        let [near_m, far_m] = camera.clip_m;
        Self {
            focal_px,
            half_px,
            near_m,
            far_m,
            slopes: camera.slopes(),
            sphere_margins: camera.sphere_margins(),
            guard_slopes: half_px.map(|half_px| (half_px + GUARD_PX) / focal_px),
            eye_in_mesh: [0.0; 3],
        }
    }

    /// Projects a point that needs no clipping, with the same result as [`ScreenProjection::project`].
    #[inline(always)]
    pub(crate) fn corner(&self, [x, y, z]: Vec3) -> ScreenVertex {
        let depth = 1.0 / z;
        let on_image = |t: f32, half_px: f32| {
            (t * depth).mul_add(self.focal_px * 256.0, half_px * 256.0).round_ties_even() as i32
        };
        ScreenVertex { x: on_image(x, self.half_px[0]), y: on_image(y, self.half_px[1]), depth }
    }
}
