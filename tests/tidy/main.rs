//! House rules that a program can check, by reading the repository: the architecture's invariants, the
//! language of comments and names, and the files that are tracked.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod architecture;
mod language;
mod markdown;
mod modules;
mod repository;
mod source;
