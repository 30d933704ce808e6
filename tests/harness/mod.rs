//! Fuzz targets: everything that the program reads from outside, each as a function of arbitrary bytes.
//!
//! The bytes are not the input itself but the edits that turn a valid input into a damaged one ([`edits`]),
//! so that most inputs get past the first parser. `tests/fuzz.rs` runs the targets with random bytes on
//! stable Rust, and `fuzz/` with the bytes of libFuzzer.
//!
//! No input may cause a panic, an endless loop or an allocation beyond its own size. An error is one line
//! that names the file; an accepted input passes a second check. A target panics otherwise.

pub mod checkpoint;
pub mod edits;
pub mod frame;
pub mod language;
pub mod protocol;
pub mod results;
pub mod sweep;
pub mod tables;
pub mod tokenizer;
pub mod trajectory;

use std::path::{Path, PathBuf};

/// A fuzz target.
#[derive(Clone, Copy, Debug)]
pub struct FuzzTarget {
    /// Name of its file in this folder and in `fuzz/fuzz_targets`.
    pub name: &'static str,
    /// Runs one case and returns `true` if its input is accepted.
    pub run: fn(&[u8]) -> bool,
    /// Number of cases of the stable test, which take a few seconds on one core.
    pub n_cases: u32,
}

/// All targets.
pub const TARGETS: [FuzzTarget; 9] = [
    FuzzTarget { name: "checkpoint", run: checkpoint::run, n_cases: 3000 },
    FuzzTarget { name: "frame", run: frame::run, n_cases: 15_000 },
    FuzzTarget { name: "language", run: language::run, n_cases: 10_000 },
    FuzzTarget { name: "protocol", run: protocol::run, n_cases: 12_000 },
    FuzzTarget { name: "results", run: results::run, n_cases: 400 },
    FuzzTarget { name: "sweep", run: sweep::run, n_cases: 7500 },
    FuzzTarget { name: "tables", run: tables::run, n_cases: 1000 },
    FuzzTarget { name: "tokenizer", run: tokenizer::run, n_cases: 5000 },
    FuzzTarget { name: "trajectory", run: trajectory::run, n_cases: 2000 },
];

/// Maximum length of an error message in bytes, beyond what it quotes from the input.
const MAX_MESSAGE_BYTES: usize = 4096;

/// Asserts that an error is one clear line that names a file or folder. Returns `false`, the result of a
/// target whose input is refused.
#[track_caller]
fn refused(message: &str, path: &Path) -> bool {
    let name = path.file_name().unwrap().to_str().unwrap();
    assert!(message.contains(name), "the message does not name {name}: {message}");
    refused_in_one_line(message)
}

/// Asserts that an error is one line of bounded length that a terminal shows as it is. Returns `false`.
#[track_caller]
fn refused_in_one_line(message: &str) -> bool {
    assert!(!message.is_empty() && !message.contains(char::is_control), "not one line: {message:?}");
    assert!(message.len() <= MAX_MESSAGE_BYTES, "{} bytes: {message}", message.len());
    false
}

/// Returns a path below the repository's root.
fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join(path)
}
