//! Pictures on the CPU: a visibility pass that finds the nearest triangle of each pixel, then a shading pass that looks
//! at every pixel once and writes its bytes straight to where the policy will read them.
//!
//! Both work on sixteen triangles or pixels at a time, in generic code over [`simd::Simd`] that [`isa`] compiles once per
//! instruction set.

mod antialias;
mod clip;
mod each;
mod encode;
mod geometry;
mod inspect;
mod isa;
mod kept;
mod kind;
mod layer;
mod lens;
mod light;
mod raster;
mod rays;
mod sample;
mod shade;
mod shadow;
mod simd;
mod sink;
mod small;
mod surface;

use core::marker::PhantomData;
use core::ops::Range;
use std::sync::{Mutex, PoisonError, TryLockError};

use rayon::prelude::*;

use super::affine::Affine;
use super::camera::Camera;
use super::posed;
use super::scene::RenderScene;
use super::{RenderError, Renderer, Samples, View, with_samples};
use crate::scene::Snapshot;
use antialias::ShadeSamples;
use geometry::Draw;
pub use inspect::{Inspection, Segment};
use isa::{Isa, Kernel};
use kept::Kept;
use kind::{Block, Oversampled, Square};
pub(super) use layer::Layer;
use layer::{Renew, Still};
use lens::Pinhole;
use light::Lamps;
use raster::{Begin, Behind, Visibility};
use rays::{Aim, Rays};
use shade::{Shade, Shader, Sink};
pub(super) use shadow::StillHeights;
use shadow::{Casters, Relief, Shadow, ShadowMap};
use simd::Simd;
use sink::{Over, Picture};
use surface::{Collect, Surfaces};

/// The renderer that needs nothing but a CPU.
pub struct CpuRenderer {
    /// One per thread; which one a view is made in does not matter.
    scratches: Vec<Mutex<Scratch>>,
    /// One per env of a batch whose light casts shadows.
    shadow_maps: Vec<ShadowMap>,
    /// Per shadow map of a batch the first view of its env.
    first_views: Vec<usize>,
    /// Per view of a batch which map is its own.
    map_of_view: Vec<Option<usize>>,
    layers: Kept<Still, Layer>,
    still_heights: Kept<Casters, StillHeights>,
    isa: Isa,
    options: CpuOptions,
}

/// What a CPU renderer does, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CpuOptions {
    /// Keeps what a standing camera sees of what never moves, and its shadows, once for all scenes in which these are alike.
    /// It changes no byte; it costs 1.1 MB, 1.1 MB more with shadows and 2.5 MB more with four samples per pixel.
    pub keep_layers: bool,
    /// How a pixel is sampled.
    pub samples: Samples,
}

impl Default for CpuOptions {
    fn default() -> Self {
        Self { keep_layers: true, samples: Samples::One }
    }
}

/// What one view at a time is made in.
struct Scratch {
    /// From each instance's mesh to the view frame.
    maps: Vec<Affine>,
    /// The same to the centred frame, where that is another.
    centred: Vec<Affine>,
    visibility: Visibility,
    surfaces: Surfaces,
    /// Per block of pixels whether it is no longer as in a layer.
    stale: Vec<bool>,
    relief: Relief,
    /// One per make of camera, the most lately used first.
    rays: Vec<Rays>,
}

/// Makes of cameras whose rays are kept.
const N_RAYS: usize = 4;

impl CpuRenderer {
    /// A renderer for use in a rayon pool of this many threads.
    ///
    /// # Panics
    /// If `threads` is 0.
    #[must_use]
    pub fn new(threads: usize) -> Self {
        Self::with_options(threads, CpuOptions::default())
    }

    /// The same with other options.
    ///
    /// # Panics
    /// If `threads` is 0.
    #[must_use]
    pub fn with_options(threads: usize, options: CpuOptions) -> Self {
        let widest = Isa::available().pop().unwrap_or(Isa::Portable);
        Self::with_isa(threads, options, widest)
    }

    fn with_isa(threads: usize, options: CpuOptions, isa: Isa) -> Self {
        assert!(threads > 0, "a renderer needs a thread");
        let scratch = || {
            Mutex::new(Scratch {
                maps: Vec::with_capacity(256),
                centred: Vec::new(),
                visibility: Visibility::new(),
                surfaces: Surfaces::new(),
                stale: Vec::new(),
                relief: Relief::new(),
                rays: (0..N_RAYS).map(|_| Rays::new()).collect(),
            })
        };
        Self {
            scratches: (0..threads).map(|_| scratch()).collect(),
            shadow_maps: Vec::new(),
            first_views: Vec::new(),
            map_of_view: Vec::new(),
            layers: Kept::new(),
            still_heights: Kept::new(),
            isa,
            options,
        }
    }

    /// Fills every view's `out`: [`Renderer::render`], which cannot fail here.
    ///
    /// # Panics
    /// If a view's camera does not exist, its `out` is not of its camera's size, or its snapshot is not of its scene.
    pub fn draw(&mut self, views: &mut [View<'_>]) {
        views.iter().for_each(View::check);
        self.draw_shadows(views);
        let this = &*self;
        views.par_iter_mut().zip(&this.map_of_view).with_max_len(1).for_each(|(view, map)| {
            let map = map.map(|i| &this.shadow_maps[i]);
            this.with_scratch(|scratch| scratch.render(this, view, map));
        });
    }

    /// Every camera's side and its image, `[side, side, 3] u8` sRGB.
    ///
    /// # Panics
    /// If the snapshot is not of the scene.
    #[must_use]
    pub fn photograph(&mut self, scene: &RenderScene, snapshot: &Snapshot) -> Vec<(usize, Vec<u8>)> {
        let sides = (0..scene.n_cameras()).map(|camera_idx| scene.side(camera_idx));
        let mut images: Vec<_> = sides.map(|side| (side, vec![0; side * side * 3])).collect();
        let views = images.iter_mut().enumerate();
        let mut views: Vec<View<'_>> =
            views.map(|(camera_idx, (_, out))| View { scene, snapshot, camera_idx, out }).collect();
        self.draw(&mut views);
        images
    }

    /// Draws one shadow map per env that needs one: the views of an env follow each other.
    fn draw_shadows(&mut self, views: &[View<'_>]) {
        self.map_of_view.clear();
        self.first_views.clear();
        for (i, view) in views.iter().enumerate() {
            let shadows = view.scene.shadow_centre.is_some();
            if shadows && !(i > 0 && view.is_of_env(&views[i - 1])) {
                self.first_views.push(i);
            }
            self.map_of_view.push(shadows.then(|| self.first_views.len() - 1));
        }
        while self.shadow_maps.len() < self.first_views.len() {
            self.shadow_maps.push(ShadowMap::new());
        }
        let mut maps = core::mem::take(&mut self.shadow_maps);
        let keep = self.options.keep_layers.then_some(&self.still_heights);
        maps.par_iter_mut().zip(&self.first_views).for_each(|(map, first)| {
            let View { scene, snapshot, .. } = &views[*first];
            self.with_scratch(|scratch| map.draw(self.isa, scene, snapshot, keep, &mut scratch.relief));
        });
        self.shadow_maps = maps;
    }

    /// Runs `work` with a scratch that no other thread uses: the worker's own unless a larger pool shares it.
    fn with_scratch<T>(&self, work: impl FnOnce(&mut Scratch) -> T) -> T {
        let own = rayon::current_thread_index().unwrap_or(0) % self.scratches.len();
        let (before, after) = self.scratches.split_at(own);
        for scratch in after.iter().chain(before) {
            // Nothing in a scratch outlives a view, so one that a panic left behind is as good as new.
            match scratch.try_lock() {
                Ok(mut free) => return work(&mut free),
                Err(TryLockError::Poisoned(left)) => return work(&mut left.into_inner()),
                Err(TryLockError::WouldBlock) => {}
            }
        }
        work(&mut self.scratches[own].lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Renderer for CpuRenderer {
    fn name(&self) -> String {
        let name = format!("cpu ({}, {} threads)", self.isa.name(), self.scratches.len());
        with_samples(name, self.options.samples)
    }

    fn identity(&self) -> String {
        with_samples("cpu".to_owned(), self.options.samples)
    }

    fn render(&mut self, views: &mut [View<'_>]) -> Result<(), RenderError> {
        self.draw(views);
        Ok(())
    }
}

/// What is seen, by which camera, and the instruction set to draw it with.
#[derive(Clone, Copy)]
struct Shot<'a> {
    isa: Isa,
    scene: &'a RenderScene,
    camera: &'a Camera,
}

/// Finds where every instance is.
struct Pose<'a> {
    scene: &'a RenderScene,
    snapshot: &'a Snapshot,
    view_from_world: Affine,
    maps: &'a mut Vec<Affine>,
}

impl Kernel for Pose<'_> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        posed::pose(self.scene, self.snapshot, &self.view_from_world, self.maps);
    }
}

impl Scratch {
    /// Makes one picture.
    fn render(&mut self, renderer: &CpuRenderer, view: &mut View<'_>, map: Option<&ShadowMap>) {
        match renderer.options.samples {
            Samples::One => self.render_as::<Square>(renderer, view, map),
            Samples::Four => self.render_as::<Oversampled>(renderer, view, map),
        }
    }

    fn render_as<B: Block>(&mut self, renderer: &CpuRenderer, view: &mut View<'_>, map: Option<&ShadowMap>) {
        let CpuRenderer { isa, options, layers, .. } = renderer;
        let (isa, scene, camera) = (*isa, view.scene, &view.scene.cameras[view.camera_idx]);
        let view_from_world = camera.view_from_world(view.snapshot);
        isa.run(Pose { scene, snapshot: view.snapshot, view_from_world, maps: &mut self.maps });
        self.aim(isa, camera);
        let (shot, lamps) = (Shot { isa, scene, camera }, Lamps::new(scene, &view_from_world));
        let shadow = map.map(|map| map.seen_from(&view_from_world));
        if !(options.keep_layers && camera.stands()) {
            self.clear::<B>(shot);
            self.draw::<B>(shot, 0..scene.instances.len());
            self.shade::<B>(shot, &lamps, shadow, None, Picture::new(view.out, camera.side));
            return;
        }
        let layer = &*self.layer::<B>(shot, view, &lamps, map, layers);
        self.begin::<B>(shot, Behind::Depths(&layer.depths));
        self.draw::<B>(shot, scene.n_still..scene.instances.len());
        let mut stale = core::mem::take(&mut self.stale);
        isa.run(Renew {
            visibility: &mut self.visibility,
            samples_per_edge: B::SAMPLES_PER_EDGE,
            layer,
            moving: map.map(|map| &map.moving),
            stale: &mut stale,
        });
        let sink = Over::new(&layer.pixels, view.out, camera.side);
        self.shade::<B>(shot, &lamps, shadow, Some(&stale), sink);
        self.stale = stale;
    }

    /// Forgets what was seen.
    fn clear<B: Block>(&mut self, shot: Shot<'_>) {
        self.begin::<B>(shot, Behind::Nothing(1.0 / shot.camera.clip_m[1]));
    }

    /// Begins a picture.
    fn begin<B: Block>(&mut self, Shot { isa, camera, .. }: Shot<'_>, behind: Behind<'_>) {
        let side = camera.side * B::SAMPLES_PER_EDGE;
        isa.run(Begin { visibility: &mut self.visibility, side, behind, blocks: PhantomData::<B> });
    }

    /// Finds what every pixel sees of some of the instances.
    fn draw<B: Block>(&mut self, shot: Shot<'_>, which: Range<usize>) {
        let mut maps = &self.maps[which.clone()];
        if let Some(centring) = shot.camera.centring() {
            self.centred.clear();
            self.centred.extend(maps.iter().map(|map| centring.after(map)));
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
    fn shade<B: Block>(
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
    fn aim(&mut self, isa: Isa, camera: &Camera) {
        let known = self.rays.iter().position(|rays| rays.are_of(camera));
        self.rays[..=known.unwrap_or(N_RAYS - 1)].rotate_right(1);
        if known.is_none() {
            isa.run(Aim { rays: &mut self.rays[0], camera });
        }
    }
}

#[cfg(test)]
mod tests {
    use ipc_types::ControlMode;

    use super::{CpuOptions, CpuRenderer, Isa};
    use crate::TaskId;
    use crate::physics::World;
    use crate::render::{RenderScene, Samples, View};
    use crate::scene::{Scene, Snapshot, Texture};

    /// A task's scene with textures on everything, and with shadows if wanted.
    fn decorated(task: TaskId, seed: u64, shadows: bool) -> Scene {
        let mut scene = (task.task().nominal)().draw(seed);
        scene.lights.shadows = shadows;
        let parts = scene.bodies.iter_mut().flat_map(|body| &mut body.parts);
        for (i, part) in parts.enumerate() {
            part.paint.texture = Some(Texture::PERTURBATION[(i + 17) % Texture::PERTURBATION.len()]);
        }
        scene
    }

    fn images(isa: Isa, options: CpuOptions, scene: &Scene) -> Vec<Vec<u8>> {
        let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
        World::build(scene, ControlMode::JointPos).write_snapshot(&mut snapshot);
        let scene = RenderScene::new(scene);
        let image = |camera_idx| {
            let mut out = vec![0; scene.side(camera_idx).pow(2) * 3];
            let view = View { scene: &scene, snapshot: &snapshot, camera_idx, out: &mut out };
            CpuRenderer::with_isa(1, options, isa).draw(&mut [view]);
            out
        };
        (0..scene.n_cameras()).map(image).collect()
    }

    #[test]
    fn every_instruction_set_makes_the_same_bytes() {
        for &task in TaskId::ALL {
            for (shadows, samples) in [(false, Samples::One), (true, Samples::One), (true, Samples::Four)] {
                let scene = decorated(task, 3, shadows);
                let options = CpuOptions { samples, ..CpuOptions::default() };
                let first = images(Isa::Portable, options, &scene);
                for isa in Isa::available() {
                    assert!(
                        images(isa, options, &scene) == first,
                        "{isa:?}, {task:?}, {shadows}, {samples:?}"
                    );
                }
            }
        }
    }
}
