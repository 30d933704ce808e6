//! Policies and the host that serves them: observations in through shared memory, action chunks out.
//!
//! A policy sees only what crosses the link; this crate knows nothing of the simulator. Its arithmetic depends on the
//! observation alone: not on batch, thread count, time or environment.

pub mod act;
pub mod checkpoint;
pub mod ensemble;
pub mod generated;
pub mod idle;
pub mod load;
pub mod nn;
pub mod policy;
pub mod random;
pub mod robot_state;
pub mod serve;
pub mod spec;
pub mod synthetic;
pub mod text;

mod rows;

pub use ipc_types::run_config::QueryMode;
pub use load::{LoadError, check, load};
pub use policy::{ActionChunk, Policy, PolicyError};
pub use spec::{PolicySpec, PolicySpecError};
