//! The renderer through the crate's public door: where things appear, what hides what, and that nothing but the scene
//! decides a byte.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;
mod enlarged;
mod forms;
mod independence;
mod inspect;
mod layers;
mod light;
mod looks;
mod projection;
mod sheet;
