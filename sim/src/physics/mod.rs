//! Rigid-body simulation of one episode: the sampled scene as rapier bodies, controlled at 20 Hz.
//!
//! rapier holds the shapes and detects collisions; what moves is solved here (`solver`), because arms are
//! most of the cost of a step and their motion without contacts is known. No other module of the crate uses
//! rapier. Worlds are isolated from each other: the state of a [`World`] is a function of its scene, its
//! control mode and the actions executed so far.

mod arm;
mod bodies;
mod body;
mod collision;
mod convert;
pub mod fingerprint;
mod parameters;
mod solver;
mod state;
mod things;
mod world;

pub use parameters::Parameters;
pub use state::{ArmState, BodyState, WorldState};
pub use world::{CONTROL_HZ, World};
