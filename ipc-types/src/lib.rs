//! What crosses the boundary between the sim and a policy: morphologies, the byte layout of every tensor, the message
//! headers, and the link that carries them through shared memory.
//!
//! This crate depends on no other crate of the project: a foreign policy host (Python, C++) needs only what is here.

pub mod core_time;
pub mod frame;
pub mod layout;
pub mod link;
pub mod morphology;

pub use frame::{ActionHeader, ActionView, FrameError, ObservationHeader, ObservationView};
pub use layout::{ActionBlock, EXTERNAL_SIDE, EnvRecord, HAND_SIDE, Page, SCHEMA_HASH};
pub use morphology::{ControlMode, Morphology};
