//! The interface of all renderers: views, errors, and the trait.

use run_config::Samples;
use thiserror::Error;

use super::prepared::RenderScene;
use scene::Snapshot;

/// One image to render.
pub struct View<'a> {
    /// The static description of the scene.
    pub scene: &'a RenderScene,
    /// Poses of all bodies and links; must have as many bodies and arms as the scene.
    pub snapshot: &'a Snapshot,
    /// Index of the camera in the scene.
    pub camera_idx: usize,
    /// The image, `[height, width, 3] u8` sRGB, row-major from the top. Every byte is written exactly once
    /// and never read.
    pub out: &'a mut [u8],
}

/// Errors that can occur while rendering. The renderer is unusable afterwards.
#[derive(Clone, Debug, Error)]
#[expect(missing_docs, reason = "the fields are named by their messages")]
pub enum RenderError {
    #[error("render on {name}: {message}")]
    Device { name: String, message: String },
}

/// A renderer: the CPU or a GPU.
pub trait Renderer: Send {
    /// Returns a display name that includes the device.
    fn name(&self) -> String;

    /// Returns what images depend on besides their views: renderers with the same identity give the same
    /// bytes.
    fn identity(&self) -> String;

    /// Returns `true` if a GPU, or a software driver, renders.
    fn is_on_device(&self) -> bool {
        false
    }

    /// Renders every view into its `out`, on the current rayon pool or on a device.
    ///
    /// # Errors
    /// If the device fails. The contents of `out` are then unspecified, and every later call fails too.
    ///
    /// # Panics
    /// If the camera of a view does not exist, or if its `out` or snapshot does not match the camera or
    /// scene.
    fn render(&mut self, views: &mut [View<'_>]) -> Result<(), RenderError>;
}

impl View<'_> {
    /// Returns `true` if both views show the same scene and snapshot.
    pub(crate) fn is_same_env(&self, other: &View<'_>) -> bool {
        core::ptr::eq(self.scene, other.scene) && core::ptr::eq(self.snapshot, other.snapshot)
    }

    /// Asserts that camera, image size and snapshot match the scene.
    pub(crate) fn check(&self) {
        let size = self.scene.size(self.camera_idx);
        assert_eq!(self.out.len(), size.n_bytes(), "the image of a view must have {size} px");
        assert!(self.scene.fits(self.snapshot), "a snapshot must have the bodies and arms of its scene");
    }
}

/// Appends the sample count to a renderer name unless it is 1.
pub(crate) fn name_with_samples(name: String, samples: Samples) -> String {
    match samples {
        Samples::One => name,
        Samples::Four => format!("{name} with 4 samples per pixel"),
    }
}

/// Errors that can occur while opening a renderer.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the fields are named by their messages")]
pub enum OpenRendererError {
    #[error(
        "found no {wanted} that can render through Vulkan: {found}; use --renderer cpu or auto, or install a driver"
    )]
    NoAdapter { wanted: String, found: String },
    #[error("failed to open {name}: {message}")]
    Device { name: String, message: String },
    #[error(
        "this program was built without the GPU renderer; build it with `--features gpu`, or use --renderer cpu or auto"
    )]
    NotBuilt,
}
