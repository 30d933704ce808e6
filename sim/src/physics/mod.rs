//! Rigid-body simulation of one episode: the sampled scene as rapier bodies, controlled at 20 Hz.
//!
//! No other module of the crate uses rapier. Worlds are isolated from each other: the state of a [`World`] is
//! a function of its scene, its control mode and the actions executed so far.

mod arm;
mod bodies;
mod convert;
pub mod fingerprint;
mod hooks;
mod hull;
mod joint;
mod parameters;
mod state;
mod world;

pub use parameters::Parameters;
pub use state::{ArmState, BodyState, WorldState};
pub use world::{CONTROL_HZ, World};
