//! Pictures on the CPU: a visibility pass that finds the nearest triangle of each pixel, then a shading pass that looks
//! at every pixel once and writes its bytes straight to where the policy will read them.
//!
//! Both work on sixteen triangles or pixels at a time, in generic code over [`simd::Simd`] that [`isa`] compiles once per
//! instruction set.

mod clip;
mod each;
mod encode;
mod geometry;
mod inspect;
mod isa;
mod kind;
mod lens;
mod light;
mod raster;
mod rays;
mod sample;
mod shade;
mod simd;
mod surface;

use std::sync::{Mutex, PoisonError, TryLockError};

use rayon::prelude::*;

use super::camera::Camera;
use super::posed::{self, Posed};
use super::scene::RenderScene;
use super::{Renderer, View};
pub use inspect::{Inspection, Segment};
use isa::Isa;
use kind::Square;
use lens::Pinhole;
use light::Lamps;
use raster::Visibility;
use rays::Rays;
use shade::Shader;
use simd::Simd;
use surface::Surfaces;

/// The renderer that needs nothing but a CPU.
pub struct CpuRenderer {
    /// One per thread; which one a view is made in does not matter.
    scratches: Vec<Mutex<Scratch>>,
    isa: Isa,
}

/// What one view at a time is made in.
struct Scratch {
    posed: Vec<Posed>,
    visibility: Visibility,
    surfaces: Surfaces,
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
        let widest = Isa::available().pop().unwrap_or(Isa::Portable);
        Self::with_isa(threads, widest)
    }

    fn with_isa(threads: usize, isa: Isa) -> Self {
        assert!(threads > 0, "a renderer needs a thread");
        let scratch = || {
            Mutex::new(Scratch {
                posed: Vec::with_capacity(256),
                visibility: Visibility::new(),
                surfaces: Surfaces::new(),
                rays: (0..N_RAYS).map(|_| Rays::new()).collect(),
            })
        };
        Self { scratches: (0..threads).map(|_| scratch()).collect(), isa }
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
        format!("cpu ({}, {} threads)", self.isa.name(), self.scratches.len())
    }

    fn render(&mut self, views: &mut [View<'_>]) {
        let this = &*self;
        views.par_iter_mut().with_max_len(1).for_each(|view| {
            let side = view.scene.side(view.camera_idx);
            assert_eq!(view.out.len(), side * side * 3, "a view's bytes are [side, side, 3]");
            assert!(view.scene.fits(view.snapshot), "a snapshot has the bodies and arms of its scene");
            this.with_scratch(|scratch| this.isa.render(scratch, view));
        });
    }
}

impl Scratch {
    /// Makes one picture. This and all that it runs through is inlined into one function per instruction set.
    #[inline(always)]
    fn render<S: Simd>(&mut self, view: &mut View<'_>) {
        let (scene, camera) = (view.scene, &view.scene.cameras[view.camera_idx]);
        let view_from_world = camera.view_from_world(view.snapshot);
        posed::pose(view, &view_from_world, &mut self.posed);
        self.draw::<S>(scene, camera);
        self.surfaces.collect::<S>(scene, camera, &self.posed, &self.visibility);
        self.aim::<S>(camera);
        let lamps = Lamps::new(scene, &view_from_world);
        let shader = Shader { lamps: &lamps, rays: &self.rays[0], surfaces: &self.surfaces };
        shader.write::<S>(&self.visibility, view.out);
    }

    /// Finds what every pixel sees.
    #[inline(always)]
    fn draw<S: Simd>(&mut self, scene: &RenderScene, camera: &Camera) {
        self.visibility.clear::<Square>(camera.side, 1.0 / camera.clip_m[1]);
        let mut lens = Pinhole::new(camera);
        for ((instance, posed), &first_id) in scene.instances.iter().zip(&self.posed).zip(&scene.first_id) {
            let (mesh, map) = (instance.mesh(), &posed.view_from_mesh);
            if lens.misses_ball(map.point(mesh.centre), mesh.radius * map.stretch()) {
                continue;
            }
            lens.set_eye(map.origin_before());
            geometry::draw::<S, Square, _>(&mesh.batches, map, &lens, first_id as i32, &mut self.visibility);
        }
    }

    /// Makes the camera's rays the first ones.
    #[inline(always)]
    fn aim<S: Simd>(&mut self, camera: &Camera) {
        let known = self.rays.iter().position(|rays| rays.are_of(camera));
        self.rays[..=known.unwrap_or(N_RAYS - 1)].rotate_right(1);
        if known.is_none() {
            self.rays[0].aim::<S>(camera);
        }
    }
}

#[cfg(test)]
mod tests {
    use ipc_types::ControlMode;

    use super::{CpuRenderer, Isa};
    use crate::TaskId;
    use crate::physics::World;
    use crate::render::{RenderScene, Renderer, View};
    use crate::scene::Snapshot;

    #[test]
    fn every_instruction_set_makes_the_same_bytes() {
        for &task in TaskId::ALL {
            let scene = (task.task().nominal)().draw(3);
            let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
            World::build(&scene, ControlMode::JointPos).write_snapshot(&mut snapshot);
            let scene = RenderScene::new(&scene);
            for camera_idx in 0..scene.n_cameras() {
                let images = Isa::available().into_iter().map(|isa| {
                    let mut out = vec![0; scene.side(camera_idx).pow(2) * 3];
                    let view = View { scene: &scene, snapshot: &snapshot, camera_idx, out: &mut out };
                    CpuRenderer::with_isa(1, isa).render(&mut [view]);
                    (isa, out)
                });
                let images: Vec<(Isa, Vec<u8>)> = images.collect();
                for (isa, image) in &images {
                    assert!(*image == images[0].1, "{isa:?} differs, {task:?}, camera {camera_idx}");
                }
            }
        }
    }
}
