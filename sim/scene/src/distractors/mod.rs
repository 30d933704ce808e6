//! Catalogue of distractor objects: everyday objects that no task mentions.
//!
//! The objects are data: the files under `kinds/`, one per theme, are embedded and interpreted. Placement on
//! the table is the concern of `draw/distractors.rs`.
//!
//! To add an object, append it to a file; `kinds/README.md` documents the format.

mod builder;
mod curve;
mod distractor;
mod interpreter;
mod kind;
mod outline;
mod paint;
mod recipe;
mod shape;
mod surface;

pub use distractor::Distractor;
pub use kind::{DistractorKind, apple_profile};
