//! The policies through their public door: messages in, action blocks out.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod batch;
mod checkpoint;
mod clip;
mod ensemble;
mod independence;
mod lerobot;
mod parity;
mod serve;
mod weightless;

use std::path::PathBuf;

use ipc_types::ActionBlock;

/// A file or folder of the committed test data.
fn data(name: &str) -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "tests/data", name].iter().collect()
}

/// The rows of an answer.
fn rows(block: &ActionBlock) -> &[f32] {
    &block.rows[..(block.n_rows * block.action_dim) as usize]
}

#[track_caller]
fn assert_says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "`{message}` does not say `{part}`");
    }
}
