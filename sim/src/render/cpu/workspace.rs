//! Making one picture after the other: what is seen, then its light.

use core::marker::PhantomData;
use core::ops::Range;

use super::antialias::ShadeSamples;
use super::geometry::Draw;
use super::isa::Isa;
use super::kind::{Block, Oversampled, Square};
use super::layer::Renew;
use super::lens::Pinhole;
use super::light::Lamps;
use super::raster::{Begin, Behind, Visibility};
use super::rays::{Aim, Rays};
use super::shade::{Shade, Shader, Sink};
use super::shadow::{Relief, Shadow, ShadowMap};
use super::sink::{Over, Picture};
use super::surface::{Collect, Surfaces};
use super::{CpuRenderer, Pose};
use crate::render::math::affine::Affine3;
use crate::render::scene::RenderScene;
use crate::render::scene::camera::PinholeCamera;
use crate::render::{Samples, View};
use crate::scene::Snapshot;

/// What is seen, by which camera, and the instruction set to draw it with.
#[derive(Clone, Copy)]
pub(super) struct Shot<'a> {
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
    pub(super) surfaces: Surfaces,
    /// Per block of pixels whether it is no longer as in a layer.
    pub(super) stale: Vec<bool>,
    relief: Relief,
    /// One per make of camera, the most lately used first.
    pub(super) rays: Vec<Rays>,
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
            surfaces: Surfaces::new(),
            stale: Vec::new(),
            relief: Relief::new(),
            rays: (0..N_RAYS).map(|_| Rays::new()).collect(),
        }
    }

    /// Draws the shadow map of a scene whose light casts shadows.
    pub(super) fn draw_map(
        &mut self,
        renderer: &CpuRenderer,
        scene: &RenderScene,
        snapshot: &Snapshot,
        map: &mut ShadowMap,
    ) {
        map.draw(renderer.isa, scene, snapshot, &renderer.still_heights, &mut self.relief);
    }

    /// Makes one picture.
    pub(super) fn draw(&mut self, renderer: &CpuRenderer, view: &mut View<'_>, map: Option<&ShadowMap>) {
        match renderer.options.samples {
            Samples::One => self.draw_as::<Square>(renderer, view, map),
            Samples::Four => self.draw_as::<Oversampled>(renderer, view, map),
        }
    }

    fn draw_as<B: Block>(&mut self, renderer: &CpuRenderer, view: &mut View<'_>, map: Option<&ShadowMap>) {
        let CpuRenderer { isa, options, layers, .. } = renderer;
        let (isa, scene, camera) = (*isa, view.scene, &view.scene.cameras[view.camera_idx]);
        let view_from_world = camera.view_from_world(view.snapshot);
        isa.run(Pose { scene, snapshot: view.snapshot, view_from_world, maps: &mut self.maps });
        self.aim(isa, camera);
        let (shot, lamps) = (Shot { isa, scene, camera }, Lamps::new(scene, &view_from_world));
        let shadow = map.and_then(|map| map.seen_from(&view_from_world));
        if !(options.keep_layers && camera.is_static()) {
            self.clear::<B>(shot);
            self.find::<B>(shot, 0..scene.instances.len());
            self.shade::<B>(shot, &lamps, shadow, None, Picture::new(view.out, camera.side));
            return;
        }
        let layer = &*self.layer::<B>(shot, view, &lamps, map, layers);
        self.begin::<B>(shot, Behind::Depths(&layer.depths));
        self.find::<B>(shot, scene.n_still..scene.instances.len());
        let mut stale = core::mem::take(&mut self.stale);
        isa.run(Renew {
            visibility: &mut self.visibility,
            samples_per_edge: B::SAMPLES_PER_EDGE,
            layer,
            moving: map.map(ShadowMap::moving),
            stale: &mut stale,
        });
        let sink = Over::new(&layer.pixels, view.out, camera.side);
        self.shade::<B>(shot, &lamps, shadow, Some(&stale), sink);
        self.stale = stale;
    }

    /// Forgets what was seen.
    pub(super) fn clear<B: Block>(&mut self, shot: Shot<'_>) {
        self.begin::<B>(shot, Behind::Nothing(1.0 / shot.camera.clip_m[1]));
    }

    /// Begins a picture.
    fn begin<B: Block>(&mut self, Shot { isa, camera, .. }: Shot<'_>, behind: Behind<'_>) {
        let side = camera.side * B::SAMPLES_PER_EDGE;
        isa.run(Begin { visibility: &mut self.visibility, side, behind, blocks: PhantomData::<B> });
    }

    /// Finds what every pixel sees of some of the instances.
    pub(super) fn find<B: Block>(&mut self, shot: Shot<'_>, which: Range<usize>) {
        let mut maps = &self.maps[which.clone()];
        if let Some(centring) = shot.camera.centring_shear() {
            self.centred.clear();
            self.centred.extend(maps.iter().map(|map| centring.compose(map)));
            maps = &self.centred;
        }
        shot.isa.run(Draw {
            instances: &shot.scene.instances[which.clone()],
            maps,
            first_ids: &shot.scene.first_id[which],
            lens: Pinhole::new(shot.camera, B::SAMPLES_PER_EDGE),
            visibility: &mut self.visibility,
            blocks: PhantomData::<B>,
        });
    }

    /// Shades what is seen, or the blocks of pixels that are stale.
    pub(super) fn shade<B: Block>(
        &mut self,
        shot: Shot<'_>,
        lamps: &Lamps,
        shadow: Option<Shadow<'_>>,
        stale: Option<&[bool]>,
        sink: impl Sink,
    ) {
        let Self { maps, visibility, surfaces, rays, .. } = self;
        let Shot { isa, scene, camera } = shot;
        let scale = B::SAMPLES_PER_EDGE;
        isa.run(Collect { scene, camera, maps, visibility, scale, stale, surfaces });
        let shader = Shader { lamps, rays: &rays[0], surfaces, shadow };
        if scale == 1 {
            isa.run(Shade { shader, visibility, sink });
        } else {
            isa.run(ShadeSamples { shader, visibility, sink });
        }
    }

    /// Makes the camera's rays the first ones.
    fn aim(&mut self, isa: Isa, camera: &PinholeCamera) {
        let known = self.rays.iter().position(|rays| rays.are_of(camera));
        self.rays[..=known.unwrap_or(N_RAYS - 1)].rotate_right(1);
        if known.is_none() {
            isa.run(Aim { rays: &mut self.rays[0], camera });
        }
    }
}
