//! Data plane between the sim and a policy host: morphologies, the byte layout of every tensor, the message
//! headers, and the link that carries messages through shared memory. Also the options of a run, which all
//! processes share.
//!
//! This crate depends on no other crate of the workspace: a foreign policy host (Python, C++) needs only
//! what is here.

pub mod allotment;
mod checksum;
mod error_chain;
pub mod frame;
pub mod input;
pub mod layout;
mod lifeline;
pub mod link;
pub mod morphology;
mod os_error;
pub mod run_config;
pub mod trace;

pub use error_chain::{error_chain, one_line, printable, shorten};
pub use frame::{ActionHeader, ActionView, FrameError, ObservationHeader, ObservationView};
pub use layout::{ActionBlock, EXTERNAL_SIDE, EnvRecord, HAND_SIDE, Page, SCHEMA_HASH};
pub use lifeline::Lifeline;
pub use morphology::{ControlMode, Morphology};
pub use os_error::{cure, is_refusal};
pub use run_config::RunConfig;
