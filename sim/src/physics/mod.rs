//! Physics of one episode: a drawn scene as rapier bodies, stepped 20 times a second of simulated time.
//!
//! rapier is known here and nowhere else in the crate. A [`World`] is isolated from all others; what it does is a function
//! of its scene, its control mode and the actions it was given.

mod arm;
mod convert;
mod joint;
mod preset;
mod solids;
mod world;

pub use world::World;

/// Control steps per second of simulated time.
pub const CONTROL_HZ: f64 = 20.0;
/// Physics steps per control step.
pub const SUBSTEPS: usize = 5;
