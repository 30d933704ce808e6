//! The repository's files as text, and helpers that split them into code and comments.

use std::fs;
use std::path::{Path, PathBuf};

/// Workspace members, which hold all Rust sources.
pub(crate) const CRATES: [&str; 8] =
    ["ipc-types", "run-config", "gpu", "sim", "policy-host", "orchestrator", "benches", "tests"];

/// A text file of the repository.
pub(crate) struct Source {
    /// Path relative to the repository's root.
    pub(crate) path: String,
    pub(crate) text: String,
}

/// Returns the repository's root.
pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

/// Returns the manifest of the workspace member `name`.
pub(crate) fn manifest(name: &str) -> String {
    fs::read_to_string(root().join(name).join("Cargo.toml")).unwrap()
}

/// Returns every file below `dir` that is not hidden and not a build product.
pub(crate) fn files_below(dir: &Path) -> Vec<PathBuf> {
    let products = ["target", "__pycache__", "build"];
    let is_product =
        |name: &str| products.contains(&name) || name.ends_with(".egg-info") || name.ends_with(".so");
    let skipped = |name: &str| name.starts_with('.') || is_product(name);
    let mut files = Vec::new();
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap();
        if skipped(name) {
            continue;
        }
        if path.is_dir() {
            files.extend(files_below(&path));
        } else {
            files.push(path);
        }
    }
    files
}

/// Returns `path` relative to the repository's root.
pub(crate) fn relative(path: &Path) -> String {
    path.strip_prefix(root()).unwrap().to_str().unwrap().to_owned()
}

/// Returns all Rust sources of the workspace.
pub(crate) fn rust_sources() -> Vec<Source> {
    let sources = with_extension(&["rs"]);
    assert!(sources.len() > 50, "found only {} source files", sources.len());
    sources
}

/// Returns the workspace members' and the Python package's files with one of these extensions.
pub(crate) fn with_extension(extensions: &[&str]) -> Vec<Source> {
    let matches = |path: &PathBuf| {
        path.extension().is_some_and(|extension| extensions.iter().any(|wanted| extension == *wanted))
    };
    let folders = CRATES.iter().chain(&["python"]).map(|name| root().join(name));
    let paths = folders.flat_map(|folder| files_below(&folder)).filter(matches);
    paths.map(|path| Source { path: relative(&path), text: fs::read_to_string(&path).unwrap() }).collect()
}

impl Source {
    /// Returns the code without comments and without the unit tests at the end of the file.
    pub(crate) fn code(&self) -> String {
        let text = self.text.split("#[cfg(test)]\nmod ").next().unwrap();
        text.lines().map(|line| line.split("//").next().unwrap()).collect::<Vec<_>>().join("\n")
    }

    /// Returns the lines with their numbers, counted from 1.
    pub(crate) fn numbered(&self) -> impl Iterator<Item = (usize, &str)> {
        (1..).zip(self.text.lines())
    }

    /// Returns the doc comments (`///` and `//!`): the number of the first line and the text of all lines of
    /// each.
    pub(crate) fn docs(&self) -> Vec<(usize, Vec<&str>)> {
        let mut docs: Vec<(usize, Vec<&str>)> = Vec::new();
        let mut continues = false;
        for (number, line) in self.numbered() {
            let line = line.trim_start();
            let doc = line.strip_prefix("///").or_else(|| line.strip_prefix("//!"));
            match (doc, continues) {
                (Some(text), true) => docs.last_mut().unwrap().1.push(text.trim()),
                (Some(text), false) => docs.push((number, vec![text.trim()])),
                (None, _) => {}
            }
            continues = doc.is_some();
        }
        docs
    }
}

/// Fails with `rule` and the places that break it, if there are any.
#[track_caller]
pub(crate) fn assert_none(violations: &[String], rule: &str) {
    assert!(violations.is_empty(), "{rule}:\n{}", violations.join("\n"));
}
