//! The link, through its public door and between real processes: this binary starts itself again for the other side.

#![expect(clippy::unwrap_used, reason = "a helper of a test fails as the test does")]

mod allocations;
#[path = "../../../tests/counting.rs"]
mod counting;
mod domains;
mod foreign;
mod memory;
mod processes;
mod roles;
mod scratch;
