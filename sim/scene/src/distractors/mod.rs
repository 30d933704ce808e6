//! Catalogue of distractor objects: everyday objects that no task mentions.
//!
//! Each kind is one function that samples an object (its size, colours and print) from a stream; one file
//! holds the kinds of one theme. Placement on the table is the concern of `scene/draw/distractors.rs`.

mod appearance;
mod balls;
mod banana;
mod bottles;
mod builder;
mod cans;
mod cartons;
mod catalogue;
mod cutlery;
mod distractor;
mod fruit;
mod kitchenware;
mod tools;
mod toys;

pub use catalogue::DistractorKind;
pub use distractor::Distractor;
pub use fruit::APPLE_PROFILE;
