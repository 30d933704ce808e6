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
mod workspace;

use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};

use rayon::prelude::*;

use super::affine::Affine;
use super::posed;
use super::scene::RenderScene;
use super::{RenderError, Renderer, Samples, View, with_samples};
use crate::scene::Snapshot;
pub use inspect::{Inspection, Segment};
use isa::{Isa, Kernel};
use kept::Kept;
pub(super) use layer::Layer;
use layer::Still;
pub(super) use shadow::StillHeights;
use shadow::{Casters, ShadowMap};
use simd::Simd;
use workspace::Workspace;

/// The renderer that needs nothing but a CPU.
pub struct CpuRenderer {
    /// One per thread; which one a view is made in does not matter.
    scratches: Vec<Mutex<Scratch>>,
    /// One per env of a small batch.
    shadow_maps: Vec<ShadowMap>,
    /// The first view of each env of a batch.
    first_views: Vec<usize>,
    layers: Kept<Still, Layer>,
    still_heights: Kept<Casters, StillHeights>,
    isa: Isa,
    options: CpuOptions,
}

/// What a CPU renderer does, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CpuOptions {
    /// Keeps what a standing camera sees of what never moves, once for all scenes in which that is alike. It changes no byte;
    /// it costs 1.1 MB, and 2.5 MB more with four samples per pixel. The shadow map of what never moves is kept in any
    /// case: 0.8 MB for all scenes in which it is alike.
    pub keep_layers: bool,
    /// How a pixel is sampled.
    pub samples: Samples,
}

impl Default for CpuOptions {
    fn default() -> Self {
        Self { keep_layers: true, samples: Samples::One }
    }
}

/// Envs per thread from which on a batch is drawn env by env: with fewer, threads would be without work for long at its end.
const MANY: usize = 4;

/// What a thread works with.
struct Scratch {
    /// Of the env that it draws, if it draws all of it.
    map: ShadowMap,
    workspace: Workspace,
}

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
        let scratch = || Mutex::new(Scratch { map: ShadowMap::new(), workspace: Workspace::new() });
        Self {
            scratches: (0..threads).map(|_| scratch()).collect(),
            shadow_maps: Vec::new(),
            first_views: Vec::new(),
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
        self.first_views.clear();
        let starts = (0..views.len()).filter(|i| *i == 0 || !views[*i].is_of_env(&views[*i - 1]));
        self.first_views.extend(starts);
        if self.first_views.len() >= MANY * self.scratches.len() {
            self.draw_env_by_env(&self.first_views, views);
        } else {
            self.draw_view_by_view(views);
        }
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

    /// Draws some envs, of which these are all views, each in one go by one thread: its shadow map then stays in the
    /// processor's cache. Other threads may take some of them.
    fn draw_env_by_env(&self, first_views: &[usize], views: &mut [View<'_>]) {
        if let [first, _, ..] = first_views {
            let (envs, more_envs) = first_views.split_at(first_views.len() / 2);
            let (views, more_views) = views.split_at_mut(more_envs[0] - first);
            rayon::join(|| self.draw_env_by_env(envs, views), || self.draw_env_by_env(more_envs, more_views));
            return;
        }
        self.with_scratch(|Scratch { map, workspace }| {
            let map = workspace.draw_map(self, &views[0], map);
            for view in views {
                workspace.draw(self, view, map);
            }
        });
    }

    /// Draws the views of a few envs, each by any thread, once all shadow maps are drawn.
    fn draw_view_by_view(&mut self, views: &mut [View<'_>]) {
        while self.shadow_maps.len() < self.first_views.len() {
            self.shadow_maps.push(ShadowMap::new());
        }
        let mut maps = core::mem::take(&mut self.shadow_maps);
        let this = &*self;
        maps.par_iter_mut().zip(&this.first_views).for_each(|(map, first)| {
            this.with_scratch(|Scratch { workspace, .. }| {
                workspace.draw_map(this, &views[*first], map);
            });
        });
        views.par_iter_mut().enumerate().with_max_len(1).for_each(|(i, view)| {
            let env_idx = this.first_views.partition_point(|first| *first <= i) - 1;
            let map = view.scene.shadow_centre.is_some().then_some(&maps[env_idx]);
            this.with_scratch(|Scratch { workspace, .. }| workspace.draw(this, view, map));
        });
        self.shadow_maps = maps;
    }

    /// Runs `work` with a scratch that no other thread uses: the worker's own unless a larger pool shares it.
    fn with_scratch<T>(&self, work: impl FnOnce(&mut Scratch) -> T) -> T {
        let own = rayon::current_thread_index().unwrap_or(0) % self.scratches.len();
        let (before, after) = self.scratches.split_at(own);
        for scratch in after.iter().chain(before) {
            match scratch.try_lock() {
                Ok(mut free) => return work(&mut free),
                Err(TryLockError::Poisoned(left)) => return work(&mut cleaned(scratch, left)),
                Err(TryLockError::WouldBlock) => {}
            }
        }
        let own = &self.scratches[own];
        work(&mut own.lock().unwrap_or_else(|left| cleaned(own, left)))
    }
}

/// A scratch that a panic left behind, as good as new: of what outlives a view only the map may be half drawn.
fn cleaned<'a>(
    scratch: &Mutex<Scratch>,
    left: PoisonError<MutexGuard<'a, Scratch>>,
) -> MutexGuard<'a, Scratch> {
    let mut left = left.into_inner();
    left.map = ShadowMap::new();
    scratch.clear_poison();
    left
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
