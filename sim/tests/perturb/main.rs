//! Perturbations: what each edits, what it draws, and what it leaves alone.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;
mod distractors;
mod distributions;
mod language;
mod orthogonality;
mod strength;
mod twins;
