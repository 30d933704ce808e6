//! What people look at: the cameras' pictures at the starts of episodes or along one, as a sheet or as a movie.
//!
//! Owns how depths and segments become colours, and the files of movies. It never decides what an episode is: it draws
//! scenes and steps worlds as `serve` does, with an actor that needs no policy host.

pub mod contact_sheet;
mod depth;
mod episode;
mod film;
mod high_res;
pub mod movie;
mod paint;
mod segments;

use thiserror::Error;

pub use depth::DepthRange;
pub use episode::{Script, Subject};
pub use film::Film;
pub use high_res::HighResScene;
pub use paint::{Key, What};
pub use segments::Entry;

use crate::expert::MotionPlanError;

/// Why an episode cannot be shown.
#[derive(Debug, Error)]
pub enum ShowError {
    /// The expert's moves are out of reach.
    #[error("the expert found no plan: {0}")]
    Plan(#[from] MotionPlanError),
    /// The world blew up.
    #[error("the physics state is not finite after step {step}")]
    NotFinite {
        /// Control steps until then.
        step: u32,
    },
}
