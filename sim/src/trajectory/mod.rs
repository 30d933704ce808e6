//! Trajectories from given start states: the same state and the same actions, in this simulator or another.
//!
//! Owns the JSON format of starts, actions and recorded motions (docs/trajectories.md). Nothing is sampled
//! here except what a start leaves open: colours, light and camera errors, none of which affects the motion.

mod file;
mod replay;
mod start;

pub use file::{ArmFile, BodyFile, RecordedFile, TrajectoryError, TrajectoryFile, read_actions};
pub use replay::{ArmStep, Replay, Step};
pub(crate) use start::SIZE_TOLERANCE;
pub use start::Start;
