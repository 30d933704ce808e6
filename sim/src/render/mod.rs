//! Pictures of worlds: a [`Scene`](crate::scene::Scene) once, a [`Snapshot`] per picture, sRGB bytes out.
//!
//! Owns the meshes, textures and shading rules; never steps a world and never draws a random number. A picture depends
//! on its scene, snapshot and camera alone, not on the batch or the threads. `cpu` makes the same bytes on every machine;
//! `gpu` makes the same bytes on one device, and nearly those of `cpu`. Both follow `SHADING.md`.

mod choice;
mod cpu;
pub mod export;
pub mod gpu;
mod math;
mod mesh;
mod scene;
mod shading;
mod texture;

pub use choice::{OpenError, open};
pub use cpu::{CpuOptions, CpuRenderer, Inspection, Segment};
pub use gpu::GpuRenderer;
pub use ipc_types::run_config::{RendererChoice, Samples};
pub use scene::RenderScene;

use thiserror::Error;

use crate::scene::Snapshot;

/// One picture to make.
pub struct View<'a> {
    /// What does not move.
    pub scene: &'a RenderScene,
    /// Where everything is; as many bodies and arms as the scene has.
    pub snapshot: &'a Snapshot,
    /// Which of the scene's cameras.
    pub camera_idx: usize,
    /// `[side, side, 3] u8` sRGB, row-major, top row first; every byte is written exactly once and none is read.
    pub out: &'a mut [u8],
}

/// Why pictures could not be made; the renderer makes no others.
#[derive(Clone, Debug, Error)]
#[expect(missing_docs, reason = "the fields are named by their messages")]
pub enum RenderError {
    #[error("draw on {name}: {message}")]
    Device { name: String, message: String },
}

/// A way to make pictures.
pub trait Renderer: Send {
    /// Name for people, with what it runs on.
    fn name(&self) -> String;

    /// What its pictures depend on beside the views: renderers with the same identity make the same bytes.
    fn identity(&self) -> String;

    /// Fills every view's `out`, on rayon's current pool or on a device.
    ///
    /// # Errors
    /// If the device fails. What is in `out` is then undefined, and every later call fails, too.
    ///
    /// # Panics
    /// If a view's camera does not exist, its `out` is not of its camera's size, or its snapshot is not of its scene.
    fn render(&mut self, views: &mut [View<'_>]) -> Result<(), RenderError>;
}

impl View<'_> {
    /// Whether it shows the same world at the same moment as another one.
    fn is_of_env(&self, other: &View<'_>) -> bool {
        core::ptr::eq(self.scene, other.scene) && core::ptr::eq(self.snapshot, other.snapshot)
    }

    /// Asserts that its parts belong together.
    fn check(&self) {
        let side = self.scene.side(self.camera_idx);
        assert_eq!(self.out.len(), side * side * 3, "a view's bytes are [side, side, 3]");
        assert!(self.scene.fits(self.snapshot), "a snapshot has the bodies and arms of its scene");
    }
}

/// A renderer's name with how it samples, unless that is as usual.
fn with_samples(name: String, samples: Samples) -> String {
    match samples {
        Samples::One => name,
        Samples::Four => format!("{name} with 4 samples per pixel"),
    }
}
