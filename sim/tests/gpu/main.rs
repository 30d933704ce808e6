//! Tests of the GPU renderer on a software driver: its images match those of the CPU renderer and do not
//! depend on the batch.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::print_stderr, reason = "agreement tests print the worst deviation")]

mod agreement;
mod batch;
mod common;
mod options;
