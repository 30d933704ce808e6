//! The renderer: it divides views among threads, each with a workspace of its own.

use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};

use ipc_types::ImageSize;
use rayon::prelude::*;

use super::cache::shared_cache::SharedCache;
use super::settings::{CpuOptions, RenderSettings};
use super::shadow::ShadowMap;
use super::simd::isa::Isa;
use super::workspace::Workspace;
use crate::prepared::RenderScene;
use crate::renderer::{RenderError, Renderer, View, name_with_samples};
use scene::Snapshot;

/// A renderer that needs no GPU.
pub struct CpuRenderer {
    /// One per thread. Images do not depend on which one renders a view.
    workspaces: Vec<Mutex<Workspace>>,
    /// [`MAPS_PER_THREAD`] per thread. Images do not depend on which one an env uses.
    shadow_maps: Vec<Mutex<ShadowMap>>,
    /// Index of the first view of each env of the current batch.
    first_views: Vec<usize>,
    pub(crate) settings: RenderSettings,
}

/// Shadow maps per thread. Two, because a thread that waits for the last view of an env may start another
/// env.
const MAPS_PER_THREAD: usize = 2;

impl CpuRenderer {
    /// Creates a renderer with default options for use in a rayon pool of `threads` threads.
    ///
    /// # Panics
    /// If `threads` is 0.
    #[must_use]
    pub fn new(threads: usize) -> Self {
        Self::with_options(threads, CpuOptions::default())
    }

    /// Creates a renderer for use in a rayon pool of `threads` threads.
    ///
    /// # Panics
    /// If `threads` is 0.
    #[must_use]
    pub fn with_options(threads: usize, options: CpuOptions) -> Self {
        let widest = Isa::available().pop().unwrap_or(Isa::Portable);
        Self::with_isa(threads, options, widest)
    }

    pub(crate) fn with_isa(threads: usize, options: CpuOptions, isa: Isa) -> Self {
        assert!(threads > 0, "a renderer needs at least one thread");
        Self {
            workspaces: (0..threads).map(|_| Mutex::new(Workspace::new())).collect(),
            shadow_maps: (0..MAPS_PER_THREAD * threads).map(|_| Mutex::new(ShadowMap::new())).collect(),
            first_views: Vec::new(),
            settings: RenderSettings {
                isa,
                options,
                layers: SharedCache::new(),
                static_heights: SharedCache::new(),
            },
        }
    }

    /// Renders every view into its `out`. Like [`Renderer::render`], but infallible.
    ///
    /// # Panics
    /// If the camera of a view does not exist, or if its `out` or snapshot does not match the camera or
    /// scene.
    pub fn draw(&mut self, views: &mut [View<'_>]) {
        views.iter().for_each(View::check);
        self.first_views.clear();
        let starts = (0..views.len()).filter(|i| *i == 0 || !views[*i].is_same_env(&views[*i - 1]));
        self.first_views.extend(starts);
        self.render_envs(&self.first_views, views);
    }

    /// Renders the images of all cameras of a scene. Returns, per camera, the size and the image,
    /// `[height, width, 3] u8` sRGB.
    ///
    /// # Panics
    /// If the snapshot does not belong to the scene.
    #[must_use]
    pub fn render_cameras(&mut self, scene: &RenderScene, snapshot: &Snapshot) -> Vec<(ImageSize, Vec<u8>)> {
        self.render_camera_range(scene, snapshot, 0..scene.n_cameras())
    }

    /// Renders the images of some cameras of a scene, as [`Self::render_cameras`] does those of all.
    ///
    /// # Panics
    /// If the snapshot does not belong to the scene, or a camera does not exist.
    #[must_use]
    pub fn render_camera_range(
        &mut self,
        scene: &RenderScene,
        snapshot: &Snapshot,
        cameras: Range<usize>,
    ) -> Vec<(ImageSize, Vec<u8>)> {
        let sizes = cameras.clone().map(|camera_idx| scene.size(camera_idx));
        let mut images: Vec<_> = sizes.map(|size| (size, vec![0; size.n_bytes()])).collect();
        let views = cameras.zip(&mut images);
        let mut views: Vec<View<'_>> =
            views.map(|(camera_idx, (_, out))| View { scene, snapshot, camera_idx, out }).collect();
        self.draw(&mut views);
        images
    }

    /// Renders the envs that start at `first_views`, given all of their views. Other threads may steal
    /// work, down to single views. The shadow map of an env is rendered just before its views, into a map
    /// that this thread has used before and that is therefore likely to be in its CPU cache.
    fn render_envs(&self, first_views: &[usize], views: &mut [View<'_>]) {
        if let [first, _, ..] = first_views {
            let (envs, more_envs) = first_views.split_at(first_views.len() / 2);
            let (views, more_views) = views.split_at_mut(more_envs[0] - first);
            rayon::join(|| self.render_envs(envs, views), || self.render_envs(more_envs, more_views));
            return;
        }
        match views.first() {
            Some(View { scene, snapshot, .. }) if scene.shadow_centre.is_some() => {
                self.with_shadow_map(|map| {
                    self.with_workspace(|workspace| {
                        workspace.render_shadow_map(&self.settings, scene, snapshot, map);
                    });
                    self.render_views(views, Some(map));
                });
            }
            _ => self.render_views(views, None),
        }
    }

    fn render_views(&self, views: &mut [View<'_>], map: Option<&ShadowMap>) {
        views.par_iter_mut().with_max_len(1).for_each(|view| {
            self.with_workspace(|workspace| workspace.render(&self.settings, view, map));
        });
    }

    /// Runs `work` with exclusive access to a workspace, preferably the one that belongs to this thread.
    pub(crate) fn with_workspace<T>(&self, work: impl FnOnce(&mut Workspace) -> T) -> T {
        let own = own_index(&self.workspaces, 1);
        // No state in a workspace outlives a view, so a poisoned one is safe to reuse.
        let free = lock_free(&self.workspaces, own, |_| {});
        let wait = || self.workspaces[own].lock().unwrap_or_else(PoisonError::into_inner);
        work(&mut free.unwrap_or_else(wait))
    }

    /// Runs `work` with exclusive access to a shadow map. `work` may wait for other threads and meanwhile
    /// run the work of other envs on this thread.
    fn with_shadow_map<T>(&self, work: impl FnOnce(&mut ShadowMap) -> T) -> T {
        // A poisoned map may be partially rendered.
        let free = lock_free(&self.shadow_maps, own_index(&self.shadow_maps, MAPS_PER_THREAD), |map| {
            *map = ShadowMap::new();
        });
        match free {
            Some(mut map) => work(&mut map),
            None => work(&mut ShadowMap::new()),
        }
    }
}

/// Returns the index of the first of the `n` pool entries that belong to this thread.
fn own_index<T>(pool: &[T], n: usize) -> usize {
    rayon::current_thread_index().unwrap_or(0) * n % pool.len()
}

/// Locks the first unlocked pool entry, searching from index `own` and wrapping around. If a panic poisoned
/// it, `reset` is applied first. Returns `None` if all entries are locked.
fn lock_free<T>(pool: &[Mutex<T>], own: usize, reset: impl Fn(&mut T)) -> Option<MutexGuard<'_, T>> {
    let (before, after) = pool.split_at(own);
    after.iter().chain(before).find_map(|entry| match entry.try_lock() {
        Ok(guard) => Some(guard),
        Err(TryLockError::Poisoned(poisoned)) => {
            let mut guard = poisoned.into_inner();
            reset(&mut guard);
            entry.clear_poison();
            Some(guard)
        }
        Err(TryLockError::WouldBlock) => None,
    })
}

impl Renderer for CpuRenderer {
    fn name(&self) -> String {
        let name = format!("cpu ({}, {} threads)", self.settings.isa.name(), self.workspaces.len());
        name_with_samples(name, self.settings.options.samples)
    }

    fn identity(&self) -> String {
        name_with_samples("cpu".to_owned(), self.settings.options.samples)
    }

    fn render(&mut self, views: &mut [View<'_>]) -> Result<(), RenderError> {
        self.draw(views);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use ipc_types::{ControlMode, ImageSizes};

    use super::CpuRenderer;
    use crate::cpu::settings::CpuOptions;
    use crate::cpu::simd::isa::Isa;
    use crate::{RenderScene, Samples, View};
    use scene::{Scene, Snapshot, Texture};
    use sim::physics::World;
    use sim::{Profile, TaskId};

    /// Draws a task's scene and puts a texture on every part; `shadows` enables shadow casting.
    fn textured_scene(task: TaskId, seed: u64, shadows: bool) -> Scene {
        let mut scene = (task.task().nominal)(Profile::Strict).draw(seed);
        scene.lights.shadows = shadows;
        let parts = scene.bodies.iter_mut().flat_map(|body| &mut body.parts);
        for (i, part) in parts.enumerate() {
            part.appearance.texture = Some(Texture::PERTURBATION[(i + 17) % Texture::PERTURBATION.len()]);
        }
        scene
    }

    fn images(isa: Isa, options: CpuOptions, scene: &Scene, sizes: ImageSizes) -> Vec<Vec<u8>> {
        let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
        World::build(scene, ControlMode::JointPos).write_snapshot(&mut snapshot);
        let scene = RenderScene::new(scene, sizes);
        let image = |camera_idx| {
            let mut out = vec![0; scene.size(camera_idx).n_bytes()];
            let view = View { scene: &scene, snapshot: &snapshot, camera_idx, out: &mut out };
            CpuRenderer::with_isa(1, options, isa).draw(&mut [view]);
            out
        };
        (0..scene.n_cameras()).map(image).collect()
    }

    fn assert_isas_agree(task: TaskId, sizes: ImageSizes) {
        for (shadows, samples) in [(false, Samples::One), (true, Samples::One), (true, Samples::Four)] {
            let scene = textured_scene(task, 3, shadows);
            let options = CpuOptions { samples, ..CpuOptions::default() };
            let expected = images(Isa::Portable, options, &scene, sizes);
            for isa in Isa::available() {
                assert!(
                    images(isa, options, &scene, sizes) == expected,
                    "{isa:?}, {task:?}, {sizes}, {shadows}, {samples:?}"
                );
            }
        }
    }

    #[test]
    fn images_are_identical_on_every_instruction_set() {
        for &task in TaskId::ALL {
            assert_isas_agree(task, ImageSizes::BENCHMARK);
        }
    }

    #[test]
    fn other_sizes_are_identical_on_every_instruction_set() {
        for task in [TaskId::RaiseCube, TaskId::PlaceDishInRack, TaskId::DualArmPourPot] {
            for sizes in ["640x480,wrist=99x65", "64x64,wrist=250x66", "1280x960,wrist=64x67"] {
                assert_isas_agree(task, sizes.parse().unwrap());
            }
        }
    }
}
