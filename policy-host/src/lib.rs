//! Policies and the host that serves them: observations arrive through shared memory, action chunks return.
//!
//! A policy receives only what crosses the link; this crate does not depend on the simulator. Results depend
//! on the observation and its history alone, not on batch size, thread count, time or environment variables.

pub mod device;
pub mod formats;
pub mod generated;
pub mod load;
pub mod models;
pub mod nn;
pub mod policy;
pub mod serve;
pub mod spec;
pub mod text;
pub mod weights;

pub use formats::PolicyCheck;
pub use load::{LoadError, check, load, load_on, long_prompts};
pub use policy::{ActionChunk, Policy, PolicyError};
pub use run_config::QueryMode;
pub use spec::{PolicySpec, PolicySpecError};
