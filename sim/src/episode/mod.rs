//! Episodes: what defines one, the progress of one, and many side by side in the memory of a caller.
//!
//! Where the actions come from, and when somebody looks, is left to those who run an episode: `serve`,
//! `demo`, `show`, and the callers of `vector`.

mod spec;
mod steps;
pub mod vector;

pub use spec::EpisodeSpec;
pub use steps::DivergedError;
pub(crate) use steps::Episode;
