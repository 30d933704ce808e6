//! Episodes: their distributions, their progress, and batches of them for a caller in the same process.
//!
//! Whoever runs an episode (`serve`, `demo`, `show`, or a caller of `vector`) supplies the actions and
//! decides when to observe.

mod spec;
mod steps;
pub mod vector;

pub use spec::EpisodeSpec;
pub(crate) use steps::Episode;
pub use steps::{DivergedError, env_bytes};
