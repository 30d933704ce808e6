//! Policies and the host that serves them: observations arrive through shared memory, action chunks return.
//!
//! A policy receives only what crosses the link; this crate does not depend on the simulator. Results depend
//! on the observation and its history alone, not on batch size, thread count, time or environment variables.

pub mod act;
pub mod checkpoint;
pub mod content;
pub mod device;
pub mod ensemble;
pub mod execution;
pub mod generated;
pub mod idle;
pub mod load;
pub mod nn;
pub mod pi05;
pub mod policy;
pub mod random;
pub mod robot_state;
pub mod serve;
pub mod spec;
pub mod synthetic;
pub mod text;
pub mod weights;

#[cfg(feature = "gpu")]
mod in_flight;
mod rows;

pub use load::{LoadError, check, load, load_on, long_prompts};
pub use policy::{ActionChunk, Policy, PolicyCheck, PolicyError};
pub use run_config::QueryMode;
pub use spec::{PolicySpec, PolicySpecError};
