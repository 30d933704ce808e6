//! Pictures on the CPU: a visibility pass that finds the nearest triangle of each pixel, then a shading pass that records
//! at every pixel once and writes its bytes straight to where the policy will read them.
//!
//! Both work on sixteen triangles or pixels at a time, in generic code over [`simd::Simd`] that [`isa`] compiles once per
//! instruction set.

mod cache;
mod inspect;
mod shading;
mod shadow;
mod simd;
mod visibility;
mod workspace;

use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};

use rayon::prelude::*;

use super::math::affine::Affine3;
use super::scene::{RenderScene, transforms};
use super::{RenderError, Renderer, Samples, View, name_with_samples};
use crate::scene::Snapshot;
use cache::shared_cache::SharedCache;
use cache::static_layer::StaticLayer;
use cache::static_layer::StaticLayerKey;
pub use inspect::{Inspection, Segment};
use shadow::StaticHeights;
use shadow::{ShadowMap, StaticHeightsKey};
use simd::Simd;
use simd::isa::{Isa, Kernel};
use workspace::Workspace;

/// The renderer that needs nothing but a CPU.
pub struct CpuRenderer {
    /// One per thread; which one a view is made in does not matter.
    workspaces: Vec<Mutex<Workspace>>,
    /// [`MAPS_PER_THREAD`] per thread; which one an env's shadows are drawn in does not matter.
    maps: Vec<Mutex<ShadowMap>>,
    /// The first view of each env of a batch.
    first_views: Vec<usize>,
    layers: SharedCache<StaticLayerKey, StaticLayer>,
    static_heights: SharedCache<StaticHeightsKey, StaticHeights>,
    isa: Isa,
    options: CpuOptions,
}

/// What a CPU renderer does, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CpuOptions {
    /// Keeps what a standing camera sees of what never moves, once for all scenes in which that is alike. It changes no byte;
    /// it costs 1.1 MB, and 2.5 MB more with four samples per pixel. The shadow map of what never moves is kept in any
    /// case: 0.8 MB for all scenes in which it is alike.
    pub static_layers: bool,
    /// How a pixel is sampled.
    pub samples: Samples,
}

impl Default for CpuOptions {
    fn default() -> Self {
        Self { static_layers: true, samples: Samples::One }
    }
}

/// Shadow maps per thread: a thread that waits for an env's last view may begin another env.
const MAPS_PER_THREAD: usize = 2;

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
        Self {
            workspaces: (0..threads).map(|_| Mutex::new(Workspace::new())).collect(),
            maps: (0..MAPS_PER_THREAD * threads).map(|_| Mutex::new(ShadowMap::new())).collect(),
            first_views: Vec::new(),
            layers: SharedCache::new(),
            static_heights: SharedCache::new(),
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
        self.first_views.clear();
        let starts = (0..views.len()).filter(|i| *i == 0 || !views[*i].is_same_env(&views[*i - 1]));
        self.first_views.extend(starts);
        self.draw_envs(&self.first_views, views);
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

    /// Draws some envs, of which these are all views. Other threads may take their part, down to uniform views; an env's shadow
    /// map is drawn just before its views, into a map that this thread has used before: it is still in the processor's cache.
    fn draw_envs(&self, first_views: &[usize], views: &mut [View<'_>]) {
        if let [first, _, ..] = first_views {
            let (envs, more_envs) = first_views.split_at(first_views.len() / 2);
            let (views, more_views) = views.split_at_mut(more_envs[0] - first);
            rayon::join(|| self.draw_envs(envs, views), || self.draw_envs(more_envs, more_views));
            return;
        }
        match views.first() {
            Some(View { scene, snapshot, .. }) if scene.shadow_centre.is_some() => self.with_map(|map| {
                self.with_workspace(|workspace| workspace.render_shadow_map(self, scene, snapshot, map));
                self.draw_views(views, Some(map));
            }),
            _ => self.draw_views(views, None),
        }
    }

    fn draw_views(&self, views: &mut [View<'_>], map: Option<&ShadowMap>) {
        views.par_iter_mut().with_max_len(1).for_each(|view| {
            self.with_workspace(|workspace| workspace.draw(self, view, map));
        });
    }

    /// Runs `work` with a workspace that no other thread uses: the worker's own unless a larger pool bins it.
    fn with_workspace<T>(&self, work: impl FnOnce(&mut Workspace) -> T) -> T {
        let own = own_of(&self.workspaces, 1);
        // Nothing in a workspace outlives a view, so one that a panic left behind is as good as new.
        let free = free_from(&self.workspaces, own, |_| {});
        let waited = || self.workspaces[own].lock().unwrap_or_else(PoisonError::into_inner);
        work(&mut free.unwrap_or_else(waited))
    }

    /// Runs `work`, which may wait for other threads and take over other envs meanwhile, with a map that nobody else uses.
    fn with_map<T>(&self, work: impl FnOnce(&mut ShadowMap) -> T) -> T {
        // One that a panic left behind may be half drawn.
        let free = free_from(&self.maps, own_of(&self.maps, MAPS_PER_THREAD), |map| *map = ShadowMap::new());
        match free {
            Some(mut map) => work(&mut map),
            None => work(&mut ShadowMap::new()),
        }
    }
}

/// The first one of the things, `n` per thread, that are this thread's own.
fn own_of<T>(things: &[T], n: usize) -> usize {
    rayon::current_thread_index().unwrap_or(0) * n % things.len()
}

/// A thing that nobody uses, the first one from `own` on; `clean` if a panic left it behind.
fn free_from<T>(things: &[Mutex<T>], own: usize, clean: impl Fn(&mut T)) -> Option<MutexGuard<'_, T>> {
    let (before, after) = things.split_at(own);
    after.iter().chain(before).find_map(|thing| match thing.try_lock() {
        Ok(free) => Some(free),
        Err(TryLockError::Poisoned(left)) => {
            let mut left = left.into_inner();
            clean(&mut left);
            thing.clear_poison();
            Some(left)
        }
        Err(TryLockError::WouldBlock) => None,
    })
}

impl Renderer for CpuRenderer {
    fn name(&self) -> String {
        let name = format!("cpu ({}, {} threads)", self.isa.name(), self.workspaces.len());
        name_with_samples(name, self.options.samples)
    }

    fn identity(&self) -> String {
        name_with_samples("cpu".to_owned(), self.options.samples)
    }

    fn render(&mut self, views: &mut [View<'_>]) -> Result<(), RenderError> {
        self.draw(views);
        Ok(())
    }
}

/// Finds where every instance is.
struct TransformInstances<'a> {
    scene: &'a RenderScene,
    snapshot: &'a Snapshot,
    view_from_world: Affine3,
    maps: &'a mut Vec<Affine3>,
}

impl Kernel for TransformInstances<'_> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        transforms::write_instance_transforms(self.scene, self.snapshot, &self.view_from_world, self.maps);
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
            part.appearance.texture = Some(Texture::PERTURBATION[(i + 17) % Texture::PERTURBATION.len()]);
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
