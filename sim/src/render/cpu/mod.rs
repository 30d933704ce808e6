//! Pictures on the CPU: a visibility pass that finds the nearest triangle of each pixel, then a shading pass that looks
//! at every pixel once and writes its bytes straight to where the policy will read them.
//!
//! Numbers lie in one array per quantity and are worked on in groups of neighbouring pixels, so that the compiler
//! makes vector code of plain loops.

mod clip;
mod geometry;
mod raster;
mod shade;
mod surface;

use std::sync::{Mutex, PoisonError, TryLockError};

use rayon::prelude::*;

use super::srgb::Encoder;
use super::{Renderer, View};
use geometry::Geometry;
use raster::Visibility;
use surface::Surfaces;

/// The renderer that needs nothing but a CPU.
pub struct CpuRenderer {
    /// One per thread; which one a view is made in does not matter.
    scratches: Vec<Mutex<Scratch>>,
    encoder: Encoder,
}

/// What one view at a time is made in.
struct Scratch {
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
        assert!(threads > 0, "a renderer needs a thread");
        let scratch = || {
            Mutex::new(Scratch {
                geometry: Geometry::new(),
                visibility: Visibility::new(),
                surfaces: Surfaces::new(),
            })
        };
        Self { scratches: (0..threads).map(|_| scratch()).collect(), encoder: Encoder::new() }
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
        format!("cpu ({} threads)", self.scratches.len())
    }

    fn render(&mut self, views: &mut [View<'_>]) {
        let this = &*self;
        views.par_iter_mut().with_max_len(1).for_each(|view| {
            let side = view.scene.side(view.camera_idx);
            assert_eq!(view.out.len(), side * side * 3, "a view's bytes are [side, side, 3]");
            assert!(view.scene.fits(view.snapshot), "a snapshot has the bodies and arms of its scene");
            this.with_scratch(|scratch| scratch.render(view, &this.encoder));
        });
    }
}

impl Scratch {
    fn render(&mut self, view: &mut View<'_>, encoder: &Encoder) {
        let camera = &view.scene.cameras[view.camera_idx];
        let view_from_world = camera.view_from_world(view.snapshot);
        self.visibility.clear(camera);
        self.geometry.draw(view, &view_from_world, &mut self.visibility);
        self.surfaces.collect(view, &view_from_world, &mut self.visibility);
        shade::shade(view, &view_from_world, &self.visibility, &self.surfaces, encoder);
    }
}
