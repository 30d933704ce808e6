//! Tests of the link through its public API and between real processes: this binary re-executes itself as the
//! peer.

#![expect(clippy::unwrap_used, reason = "test helpers fail by panicking")]

mod allocations;
#[path = "../../../tests/counting.rs"]
mod counting;
mod domains;
mod foreign;
mod memory;
mod processes;
mod roles;
mod scratch;
