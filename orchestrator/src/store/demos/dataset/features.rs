//! The features of a dataset: their names, and the constants that readers must know.

/// Frames per second.
pub(crate) const FPS: u32 = 20;
/// Width of the instruction embedding.
pub(crate) const LANGUAGE_DIM: usize = 64;

pub(crate) const STATE: &str = "observation.state";
pub(crate) const LANGUAGE: &str = "observation.environment_state";
pub(crate) const ACTION: &str = "action";

/// Returns the name of a camera's feature.
pub(crate) fn camera_feature(camera: &str) -> String {
    format!("observation.images.{}", camera.strip_suffix("_camera").unwrap_or(camera))
}
