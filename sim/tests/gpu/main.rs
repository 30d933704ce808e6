//! The renderer on a GPU, tried on a software driver: it makes the pictures of the CPU's, and the same ones in every batch.
//!
//! Where there is no such driver the tests say so and pass, unless the environment variable `HYPOGEUM_REQUIRE_VULKAN` is 1.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::print_stderr, reason = "a test that is left out says why, and agreement is a figure")]

mod agreement;
mod batch;
mod common;
mod options;
