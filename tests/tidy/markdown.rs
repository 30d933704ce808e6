//! The Markdown files: the paths that they name exist.

use std::fs;
use std::path::Path;

use crate::source::{assert_none, files_below, relative, root};

/// Folders of the repository, by which a path in backticks is recognised as one of its own.
const FOLDERS: [&str; 12] = [
    "benches/",
    "checkpoints/",
    "docs/",
    "examples/",
    "ipc-types/",
    "orchestrator/",
    "policy-host/",
    "python/",
    "run-config/",
    "scripts/",
    "sim/",
    "tests/",
];

/// Returns the targets of the links of a text, without addresses and anchors.
fn links(text: &str) -> impl Iterator<Item = &str> {
    let targets = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
    let files = targets.filter(|target| !target.contains("://") && !target.starts_with(['#', '<']));
    files.map(|target| target.split(['#', ' ']).next().unwrap()).filter(|target| !target.is_empty())
}

/// Returns the paths in backticks that start with a folder of the repository. Patterns are none.
fn quoted_paths(text: &str) -> impl Iterator<Item = &str> {
    let quoted = text.lines().flat_map(|line| line.split('`').skip(1).step_by(2));
    let ours = quoted.filter(|path| FOLDERS.iter().any(|folder| path.starts_with(folder)));
    ours.filter(|path| !path.contains(['*', '{', ' ', '<', '$', ':']))
}

#[test]
fn paths_in_markdown_exist() {
    let mut n_paths = 0;
    let mut missing = Vec::new();
    let files = files_below(&root()).into_iter();
    for file in files.filter(|path| path.extension().is_some_and(|extension| extension == "md")) {
        let text = fs::read_to_string(&file).unwrap();
        let folder = file.parent().unwrap();
        let linked = links(&text).map(|target| (target, folder.join(target)));
        let quoted = quoted_paths(&text).map(|path| (path, root().join(path)));
        for (path, target) in linked.chain(quoted) {
            n_paths += 1;
            if !exists(&target) {
                missing.push(format!("{}: {path}", relative(&file)));
            }
        }
    }
    assert!(n_paths > 100, "found only {n_paths} paths");
    assert_none(&missing, "these paths do not exist");
}

/// Returns `true` if a file or folder exists, or a module of this name.
fn exists(path: &Path) -> bool {
    path.exists() || path.with_extension("rs").exists()
}
