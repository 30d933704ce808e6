//! Identifies the code that results depend on, so that results of two simulators cannot be mixed.
//!
//! `HYPOGEUM_CODE` is a hash of the sources of the simulator, the policies and what they share, and of the
//! versions of all libraries. `HYPOGEUM_COMMIT` is the commit that was checked out, for people.

use std::path::{Path, PathBuf};
use std::process::Command;

use xxhash_rust::xxh3::Xxh3;

/// The code that results depend on, from the folder of the workspace.
const SOURCES: [&str; 8] = [
    "Cargo.lock",
    "gpu/src",
    "ipc-types/src",
    "policy-host/src",
    "run-config/src",
    "sim/src",
    "sim/scene/src",
    "sim/render/src",
];

fn main() {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut files = Vec::new();
    for source in SOURCES {
        let path = workspace.join(source);
        println!("cargo::rerun-if-changed={}", path.display());
        collect(&path, &mut files);
    }
    let name = |path: &PathBuf| path.strip_prefix(&workspace).expect("it is below").to_owned();
    files.sort_by_key(name);
    let mut hash = Xxh3::new();
    for path in &files {
        let content = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        hash.update(name(path).as_os_str().as_encoded_bytes());
        hash.update(&(content.len() as u64).to_le_bytes());
        hash.update(&content);
    }
    println!("cargo::rustc-env=HYPOGEUM_CODE={:016x}", hash.digest());
    println!("cargo::rustc-env=HYPOGEUM_COMMIT={}", commit(&workspace));
}

/// Lists a file, or the files in a folder and below, except texts about them.
fn collect(path: &Path, files: &mut Vec<PathBuf>) {
    if !path.is_dir() {
        if path.extension().is_none_or(|extension| extension != "md") {
            files.push(path.to_owned());
        }
        return;
    }
    let entries = std::fs::read_dir(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    for entry in entries {
        collect(&entry.expect("the folder can be read").path(), files);
    }
}

/// Returns the commit that is checked out; "unknown" outside a repository.
fn commit(workspace: &Path) -> String {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").arg("-C").arg(workspace).args(arguments).output().ok()?;
        let text = String::from_utf8(output.stdout).ok()?.trim().to_owned();
        (output.status.success() && !text.is_empty()).then_some(text)
    };
    // It grows with every commit and checkout.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
        println!("cargo::rerun-if-changed={}", workspace.join(log).display());
    }
    git(&["rev-parse", "--short=12", "HEAD"]).unwrap_or_else(|| "unknown".to_owned())
}
