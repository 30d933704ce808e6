//! Integration tests of the perturbations: the fields that each edits, the values that it samples, and
//! everything that must stay unchanged.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;
mod distractors;
mod distributions;
mod language;
mod orthogonality;
mod profiles;
mod render_parts;
mod strength;
mod twins;
