//! Tests of the policies through the public API: observation messages in, action blocks out.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod act;
mod batch;
mod clip;
mod ensemble;
#[cfg(feature = "gpu")]
mod gpu;
mod pi05;
mod serve;
mod variants;
mod weightless;

use std::path::{Path, PathBuf};

use ipc_types::ActionBlock;
use policy_host::PolicySpec;
use policy_host::models::Family;
use policy_host::nn::Precision;

/// Returns the path of a file or folder of the committed test data.
fn data(name: &str) -> PathBuf {
    // Packed tests run where the sources are not.
    let package = std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_else(|| env!("CARGO_MANIFEST_DIR").into());
    Path::new(&package).join("tests/data").join(name)
}

/// Returns the policy of the ACT checkpoint in a folder.
fn act_spec(folder: impl Into<PathBuf>) -> PolicySpec {
    PolicySpec::network(Family::Act, Precision::F32, folder)
}

/// Returns the rows `[n_rows, action_dim]` of an action block.
fn rows(block: &ActionBlock) -> &[f32] {
    &block.rows[..(block.n_rows * block.action_dim) as usize]
}

#[track_caller]
fn assert_contains(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "`{message}` does not contain `{part}`");
    }
}
