//! Renderings for people: the camera images at the starts of episodes, or along one episode, as a contact
//! sheet or a movie.
//!
//! Owns the colour maps for depth and segmentation and the movie file formats. It does not define what an
//! episode is: it samples scenes and steps worlds as `serve` does, with an actor that needs no policy host.

pub mod contact_sheet;
mod depth;
mod episode;
mod frame_renderer;
mod high_res;
pub mod movie;
mod segmentation;
mod sequence;

use thiserror::Error;

pub use depth::DepthRange;
pub use episode::{Actor, EpisodeSpec};
pub use frame_renderer::{Legend, ViewMode};
pub use high_res::HighResScene;
pub use segmentation::LegendEntry;
pub use sequence::FrameSequence;

use crate::expert::MotionPlanError;

/// Text in the first bytes of every image and movie, by which the program recognises its own files.
pub const MARK: &str = "written-by: hypogeum";

/// Errors that can occur while rolling out an episode to show.
#[derive(Debug, Error)]
pub enum ShowError {
    /// The expert's waypoints are not reachable.
    #[error("the expert found no plan")]
    Plan(#[from] MotionPlanError),
    /// The simulation diverged.
    #[error("the physics state is not finite after step {step}")]
    NotFinite {
        /// Number of control steps taken.
        step: u32,
    },
}
