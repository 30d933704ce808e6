//! Data plane between the sim and a policy host: morphologies, the byte layout of every tensor, the message
//! headers, and the link that carries messages through shared memory.
//!
//! This crate depends on no other crate of the workspace: a foreign policy host (Python, C++) needs only
//! what is here.
//!
//! # A policy host
//!
//! `examples/attach.rs`:
//!
//! ```no_run
#![doc = include_str!("../examples/attach.rs")]
//! ```

mod checksum;
pub mod frame;
mod image_size;
pub mod layout;
pub mod link;
pub mod morphology;
mod os_error;

pub use frame::{ActionHeader, ActionView, FrameError, ObservationHeader, ObservationView};
pub use image_size::{ImageSize, ImageSizes, RGB_BYTES};
pub use layout::{ActionBlock, EnvRecord, Page, SCHEMA_HASH};
pub use morphology::{ControlMode, Morphology};
pub use os_error::{is_refusal, remedy};
