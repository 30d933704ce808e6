//! Making one picture after the other: what is seen, then its light.

use core::marker::PhantomData;
use core::ops::Range;

use super::cache::static_layer::FindStaleTiles;
use super::shading::antialias::ShadeSamples;
use super::shading::lighting::ViewLights;
use super::shading::rays::{ComputeRayTable, RayTable};
use super::shading::sink::{ImageSink, OverlaySink};
use super::shading::surface::{PrepareSurfaces, VisibleSurfaces};
use super::shading::tiles::{Shade, Shader, TileSink};
use super::shadow::{HeightRaster, Shadow, ShadowMap};
use super::simd::isa::Isa;
use super::visibility::instances::RasterizeInstances;
use super::visibility::projection::PinholeProjection;
use super::visibility::raster::{ClearTo, ClearVisibility, Visibility};
use super::visibility::tile::{MultisampleTile, Tile4x4, TileLayout};
use super::{CpuRenderer, TransformInstances};
use crate::render::math::affine::Affine3;
use crate::render::scene::RenderScene;
use crate::render::scene::camera::PinholeCamera;
use crate::render::{Samples, View};
use crate::scene::Snapshot;

/// What is seen, by which camera, and the instruction set to draw it with.
#[derive(Clone, Copy)]
pub(super) struct CameraContext<'a> {
    pub(super) isa: Isa,
    pub(super) scene: &'a RenderScene,
    pub(super) camera: &'a PinholeCamera,
}

/// What one view at a time is made in.
pub(super) struct Workspace {
    /// From each instance's mesh to the view frame.
    pub(super) maps: Vec<Affine3>,
    /// The same to the centred frame, where that is another.
    centred: Vec<Affine3>,
    pub(super) visibility: Visibility,
    pub(super) surfaces: VisibleSurfaces,
    /// Per tile of pixels whether it is no longer as in a layer.
    pub(super) stale: Vec<bool>,
    raster: HeightRaster,
    /// One per make of camera, the most lately used first.
    pub(super) rays: Vec<RayTable>,
}

/// Makes of cameras whose rays are kept.
const N_RAYS: usize = 4;

impl Workspace {
    /// Nothing in it yet.
    pub(super) fn new() -> Self {
        Self {
            maps: Vec::with_capacity(256),
            centred: Vec::new(),
            visibility: Visibility::new(),
            surfaces: VisibleSurfaces::new(),
            stale: Vec::new(),
            raster: HeightRaster::new(),
            rays: (0..N_RAYS).map(|_| RayTable::new()).collect(),
        }
    }

    /// Draws the shadow map of a scene whose light casts shadows.
    pub(super) fn render_shadow_map(
        &mut self,
        renderer: &CpuRenderer,
        scene: &RenderScene,
        snapshot: &Snapshot,
        map: &mut ShadowMap,
    ) {
        map.draw(renderer.isa, scene, snapshot, &renderer.static_heights, &mut self.raster);
    }

    /// Makes one picture.
    pub(super) fn draw(&mut self, renderer: &CpuRenderer, view: &mut View<'_>, map: Option<&ShadowMap>) {
        match renderer.options.samples {
            Samples::One => self.render_with::<Tile4x4>(renderer, view, map),
            Samples::Four => self.render_with::<MultisampleTile>(renderer, view, map),
        }
    }

    fn render_with<B: TileLayout>(
        &mut self,
        renderer: &CpuRenderer,
        view: &mut View<'_>,
        map: Option<&ShadowMap>,
    ) {
        let CpuRenderer { isa, options, layers, .. } = renderer;
        let (isa, scene, camera) = (*isa, view.scene, &view.scene.cameras[view.camera_idx]);
        let view_from_world = camera.view_from_world(view.snapshot);
        isa.run(TransformInstances { scene, snapshot: view.snapshot, view_from_world, maps: &mut self.maps });
        self.select_rays(isa, camera);
        let (context, lights) =
            (CameraContext { isa, scene, camera }, ViewLights::new(scene, &view_from_world));
        let shadow = map.and_then(|map| map.view(&view_from_world));
        if !(options.static_layers && camera.is_static()) {
            self.clear::<B>(context);
            self.rasterize::<B>(context, 0..scene.instances.len());
            self.shade::<B>(context, &lights, shadow, None, ImageSink::new(view.out, camera.side));
            return;
        }
        let layer = &*self.layer::<B>(context, view, &lights, map, layers);
        self.clear_to::<B>(context, ClearTo::Depths(&layer.depths));
        self.rasterize::<B>(context, scene.n_static..scene.instances.len());
        let mut stale = core::mem::take(&mut self.stale);
        isa.run(FindStaleTiles {
            visibility: &mut self.visibility,
            samples_per_edge: B::SAMPLES_PER_EDGE,
            layer,
            moving: map.map(ShadowMap::moving),
            stale: &mut stale,
        });
        let sink = OverlaySink::new(&layer.pixels, view.out, camera.side);
        self.shade::<B>(context, &lights, shadow, Some(&stale), sink);
        self.stale = stale;
    }

    /// Forgets what was seen.
    pub(super) fn clear<B: TileLayout>(&mut self, context: CameraContext<'_>) {
        self.clear_to::<B>(context, ClearTo::Background(1.0 / context.camera.clip_m[1]));
    }

    /// Begins a picture.
    fn clear_to<B: TileLayout>(
        &mut self,
        CameraContext { isa, camera, .. }: CameraContext<'_>,
        behind: ClearTo<'_>,
    ) {
        let side = camera.side * B::SAMPLES_PER_EDGE;
        isa.run(ClearVisibility { visibility: &mut self.visibility, side, behind, tiles: PhantomData::<B> });
    }

    /// Finds what every pixel sees of some of the instances.
    pub(super) fn rasterize<B: TileLayout>(&mut self, context: CameraContext<'_>, which: Range<usize>) {
        let mut maps = &self.maps[which.clone()];
        if let Some(centring) = context.camera.centring_shear() {
            self.centred.clear();
            self.centred.extend(maps.iter().map(|map| centring.compose(map)));
            maps = &self.centred;
        }
        context.isa.run(RasterizeInstances {
            instances: &context.scene.instances[which.clone()],
            maps,
            first_ids: &context.scene.first_id[which],
            projection: PinholeProjection::new(context.camera, B::SAMPLES_PER_EDGE),
            visibility: &mut self.visibility,
            tiles: PhantomData::<B>,
        });
    }

    /// Shades what is seen, or the tiles of pixels that are stale.
    pub(super) fn shade<B: TileLayout>(
        &mut self,
        context: CameraContext<'_>,
        lights: &ViewLights,
        shadow: Option<Shadow<'_>>,
        stale: Option<&[bool]>,
        sink: impl TileSink,
    ) {
        let Self { maps, visibility, surfaces, rays, .. } = self;
        let CameraContext { isa, scene, camera } = context;
        let scale = B::SAMPLES_PER_EDGE;
        isa.run(PrepareSurfaces { scene, camera, maps, visibility, scale, stale, surfaces });
        let shader = Shader { lights, rays: &rays[0], surfaces, shadow };
        if scale == 1 {
            isa.run(Shade { shader, visibility, sink });
        } else {
            isa.run(ShadeSamples { shader, visibility, sink });
        }
    }

    /// Makes the camera's rays the first ones.
    fn select_rays(&mut self, isa: Isa, camera: &PinholeCamera) {
        let known = self.rays.iter().position(|rays| rays.matches(camera));
        self.rays[..=known.unwrap_or(N_RAYS - 1)].rotate_right(1);
        if known.is_none() {
            isa.run(ComputeRayTable { rays: &mut self.rays[0], camera });
        }
    }
}
