//! Per-thread buffers of the CPU renderer, and the passes that use no others.

use core::marker::PhantomData;
use core::ops::Range;

use super::shading::antialias::ShadeSamples;
use super::shading::lighting::ViewLights;
use super::shading::rays::{ComputeRayTable, RayTable};
use super::shading::surface::{PrepareSurfaces, VisibleSurfaces};
use super::shading::tiles::{Shade, Shader, TileSink};
use super::shadow::{HeightRaster, Shadow};
use super::simd::isa::Isa;
use super::visibility::instances::RasterizeInstances;
use super::visibility::projection::PinholeProjection;
use super::visibility::raster::{ClearTo, ClearVisibility, Visibility};
use super::visibility::tile::{Tile4x4, TileLayout};
use crate::math::affine::Affine3;
use crate::prepared::RenderScene;
use crate::prepared::camera::PinholeCamera;

/// The scene and camera of a pass, and the instruction set that runs it.
#[derive(Clone, Copy)]
pub(crate) struct CameraContext<'a> {
    pub(crate) isa: Isa,
    pub(crate) scene: &'a RenderScene,
    pub(crate) camera: &'a PinholeCamera,
}

/// Buffers for rendering one view at a time. No state is carried from one view to the next, except for the
/// cached [`RayTable`]s.
pub(crate) struct Workspace {
    /// Per instance the transform from its mesh to the view frame.
    pub(crate) view_from_mesh: Vec<Affine3>,
    pub(crate) visibility: Visibility,
    pub(crate) surfaces: VisibleSurfaces,
    /// Per pixel tile `true` if it differs from the static layer and must be shaded again.
    pub(crate) stale: Vec<bool>,
    pub(crate) raster: HeightRaster,
    /// One per set of camera intrinsics, the most recently used first.
    pub(crate) rays: Vec<RayTable>,
}

/// Number of cached ray tables.
const N_RAY_TABLES: usize = 4;

impl Workspace {
    /// Creates an empty workspace.
    pub(crate) fn new() -> Self {
        Self {
            view_from_mesh: Vec::with_capacity(256),
            visibility: Visibility::new(),
            surfaces: VisibleSurfaces::new(),
            stale: Vec::new(),
            raster: HeightRaster::new(),
            rays: (0..N_RAY_TABLES).map(|_| RayTable::new()).collect(),
        }
    }

    /// Clears the visibility buffer to the far plane.
    pub(crate) fn clear<B: TileLayout>(&mut self, context: CameraContext<'_>) {
        self.clear_to::<B>(context, ClearTo::Background(1.0 / context.camera.clip_m[1]));
    }

    /// Resizes the visibility buffer to the camera's image and clears it.
    pub(crate) fn clear_to<B: TileLayout>(
        &mut self,
        CameraContext { isa, camera, .. }: CameraContext<'_>,
        behind: ClearTo<'_>,
    ) {
        let n_tiles = Tile4x4::cover(camera.size).map(|n| n * B::SAMPLES_PER_EDGE);
        let visibility = &mut self.visibility;
        isa.run(ClearVisibility { visibility, n_tiles, behind, tiles: PhantomData::<B> });
    }

    /// Rasterises the instances `which` into the visibility buffer.
    pub(crate) fn rasterize<B: TileLayout>(&mut self, context: CameraContext<'_>, which: Range<usize>) {
        context.isa.run(RasterizeInstances {
            instances: &context.scene.instances[which.clone()],
            maps: &self.view_from_mesh[which.clone()],
            first_ids: &context.scene.first_id[which],
            projection: PinholeProjection::new(context.camera, B::SAMPLES_PER_EDGE),
            visibility: &mut self.visibility,
            tiles: PhantomData::<B>,
        });
    }

    /// Shades the visibility buffer into `sink`: all pixel tiles, or only the stale ones if `stale` is given.
    pub(crate) fn shade<B: TileLayout>(
        &mut self,
        context: CameraContext<'_>,
        lights: &ViewLights,
        shadow: Option<Shadow<'_>>,
        stale: Option<&[bool]>,
        sink: impl TileSink,
    ) {
        let Self { view_from_mesh, visibility, surfaces, rays, .. } = self;
        let CameraContext { isa, scene, camera } = context;
        let scale = B::SAMPLES_PER_EDGE;
        isa.run(PrepareSurfaces { scene, camera, view_from_mesh, visibility, scale, stale, surfaces });
        let shader = Shader { lights, rays: &rays[0], surfaces, shadow };
        if scale == 1 {
            isa.run(Shade { shader, visibility, sink });
        } else {
            isa.run(ShadeSamples { shader, visibility, sink });
        }
    }

    /// Moves the camera's ray table to the front of the cache, computing it on a miss.
    pub(crate) fn select_ray_table(&mut self, isa: Isa, camera: &PinholeCamera) {
        let cached = self.rays.iter().position(|rays| rays.matches(camera));
        self.rays[..=cached.unwrap_or(N_RAY_TABLES - 1)].rotate_right(1);
        if cached.is_none() {
            isa.run(ComputeRayTable { rays: &mut self.rays[0], camera });
        }
    }
}
