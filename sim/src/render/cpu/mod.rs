//! Pictures on the CPU: a visibility pass that finds the nearest triangle of each pixel, then a shading pass that looks
//! at every pixel once and writes its bytes straight to where the policy will read them.
//!
//! Numbers lie in one array per quantity and are worked on in groups of neighbouring pixels, so that the compiler
//! makes vector code of plain loops.

mod clip;
mod geometry;
mod isa;
mod lanes;
mod posed;
mod raster;
mod sample;
mod shade;
mod surface;

use std::sync::{Mutex, PoisonError, TryLockError};

use rayon::prelude::*;

use super::srgb::Encoder;
use super::{RenderError, Renderer, View};
use geometry::Geometry;
use isa::Isa;
use posed::Posed;
use raster::Visibility;
use surface::Surfaces;

/// The renderer that needs nothing but a CPU.
pub struct CpuRenderer {
    /// One per thread; which one a view is made in does not matter.
    scratches: Vec<Mutex<Scratch>>,
    encoder: Encoder,
    isa: Isa,
}

/// What one view at a time is made in.
struct Scratch {
    posed: Vec<Posed>,
    geometry: Geometry,
    visibility: Visibility,
    surfaces: Surfaces,
}

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
                geometry: Geometry::new(),
                visibility: Visibility::new(),
                surfaces: Surfaces::new(),
            })
        };
        Self { scratches: (0..threads).map(|_| scratch()).collect(), encoder: Encoder::new(), isa }
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

    fn render(&mut self, views: &mut [View<'_>]) -> Result<(), RenderError> {
        let this = &*self;
        views.par_iter_mut().with_max_len(1).for_each(|view| {
            view.check();
            this.with_scratch(|scratch| this.isa.render(scratch, view, &this.encoder));
        });
        Ok(())
    }
}

impl Scratch {
    /// Makes one picture. This and all that it runs through is inlined into one function per instruction set.
    #[inline(always)]
    fn render(&mut self, view: &mut View<'_>, encoder: &Encoder) {
        let camera = &view.scene.cameras[view.camera_idx];
        let view_from_world = camera.view_from_world(view.snapshot);
        posed::pose(view, &view_from_world, &mut self.posed);
        self.visibility.clear(camera);
        self.geometry.draw(view, &self.posed, &mut self.visibility);
        self.surfaces.collect(view, &self.posed, &mut self.visibility);
        shade::shade(view, &view_from_world, &self.visibility, &self.surfaces, encoder);
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
                    CpuRenderer::with_isa(1, isa).render(&mut [view]).unwrap();
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
