//! Tests of the GPU renderer on a software driver: its images match those of the CPU renderer and do not
//! depend on the batch.
//!
//! Without a software driver the tests print a message and pass, unless the environment variable
//! `HYPOGEUM_REQUIRE_VULKAN` is 1.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(
    clippy::print_stderr,
    reason = "skipped tests print the reason, and agreement tests print the worst deviation"
)]

mod agreement;
mod batch;
mod common;
mod options;
