//! The files of the repository: none is unused, and none is large without a reason.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use crate::source::{Source, assert_none, files_below, relative, root, rust_sources};

/// Maximum size of a file in bytes, unless it is listed below.
const MAX_BYTES: u64 = 256 * 1024;
/// Larger files, each with the reason for it.
const LARGE_FILES: [(&str, &str); 16] = [
    ("checkpoints/act-all/single/model.safetensors", "weights of a bundled policy"),
    ("checkpoints/act-all/bimanual/model.safetensors", "weights of a bundled policy"),
    ("checkpoints/act-original/single/model.safetensors", "weights of a policy trained in the original"),
    ("checkpoints/pi05-all/single/model.safetensors", "weights of a bundled policy"),
    ("checkpoints/pi05-all/bimanual/model.safetensors", "weights of a bundled policy"),
    ("policy-host/tests/data/act-tiny/single/model.safetensors", "test checkpoint"),
    ("policy-host/tests/data/act-tiny/bimanual/model.safetensors", "test checkpoint"),
    ("policy-host/tests/data/lerobot/", "test checkpoints in LeRobot's layouts, with reference outputs"),
    ("policy-host/tests/data/pi05/", "test checkpoints of a narrow network, with reference outputs"),
    ("policy-host/tests/data/clip-tiny/", "test text encoder with reference outputs"),
    ("docs/baselines/index.html", "a self-contained report with all its figures"),
    ("docs/baselines/results.zip", "every episode of the baselines, to compare and verify"),
    ("docs/images/first-light.gif", "the README's animation"),
    ("docs/images/experts.jpg", "three images of each of the 28 tasks"),
    ("docs/images/gallery.jpg", "one image of each of the 28 tasks"),
    ("docs/images/perturbations.png", "one row of images per perturbation"),
];
/// Maximum number of files and folders in a folder of sources.
const MAX_ENTRIES: usize = 12;
/// Folders with more, each with the reason for it.
const LARGE_FOLDERS: [(&str, &str); 2] =
    [("sim/src/tasks", "one file per task"), ("sim/src/tasks/paraphrases", "one file per task")];
/// Files that tools find by their name or location.
const FOUND_BY_NAME: [&str; 11] = [
    "README.md",
    "LICENSE",
    "Cargo.toml",
    "Cargo.lock",
    "clippy.toml",
    "rustfmt.toml",
    "conftest.py",
    "py.typed",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "pyproject.toml",
];

#[test]
fn large_files_are_listed_with_a_reason() {
    let large: Vec<String> = files_below(&root())
        .into_iter()
        .filter(|path| path.metadata().unwrap().len() > MAX_BYTES)
        .map(|path| relative(&path))
        .filter(|path| !is_output(path))
        .filter(|path| !LARGE_FILES.iter().any(|(listed, _)| path.starts_with(listed)))
        .collect();
    assert_none(&large, "files above 256 KiB are listed in tests/tidy/repository.rs with their reason");
}

#[test]
fn source_folders_are_small() {
    let folders: BTreeSet<PathBuf> = files_below(&root())
        .into_iter()
        .flat_map(|path| path.ancestors().skip(1).map(Path::to_owned).collect::<Vec<_>>())
        .filter(|folder| folder.starts_with(root()))
        .filter(|folder| relative(folder).split('/').any(|part| part == "src"))
        .collect();
    assert!(folders.len() > 50, "found only {} folders of sources", folders.len());
    let large: Vec<String> = folders
        .iter()
        .map(|folder| (relative(folder), fs::read_dir(folder).unwrap().count()))
        .filter(|(path, n)| *n > MAX_ENTRIES && !LARGE_FOLDERS.iter().any(|(listed, _)| path == listed))
        .map(|(path, n)| format!("{path}: {n} entries"))
        .collect();
    assert_none(&large, "folders with more than 12 entries want sub-folders");
}

#[test]
fn module_with_children_is_a_mod_file() {
    let beside: Vec<String> = rust_sources()
        .into_iter()
        .filter(|source| root().join(source.path.trim_end_matches(".rs")).is_dir())
        .map(|source| source.path)
        .filter(|path| path.contains("/src/"))
        .collect();
    assert_none(&beside, "a module with children is `name/mod.rs`, not `name.rs` beside `name/`");
}

#[test]
fn every_module_file_is_declared() {
    let sources = rust_sources();
    let undeclared: Vec<String> =
        sources.iter().filter(|source| !is_declared(source)).map(|source| source.path.clone()).collect();
    assert_none(&undeclared, "every .rs file is a module of its parent or a target of its package");
}

/// Returns `true` if the module or package that contains `source` declares it.
fn is_declared(source: &Source) -> bool {
    let (folder, name) = source.path.rsplit_once('/').unwrap();
    let stem = name.trim_end_matches(".rs");
    if matches!(stem, "lib" | "main" | "bin" | "build") {
        return true;
    }
    let (parent, module) = if stem == "mod" { folder.rsplit_once('/').unwrap() } else { (folder, stem) };
    // Tasks are declared by the `task_list!` macro.
    let declarations = [format!("mod {module};"), format!("{module} => ")];
    let path_attribute = format!("{name}\"]");
    let siblings = fs::read_dir(root().join(parent)).unwrap().map(|entry| entry.unwrap().path());
    let parents = siblings.chain([root().join(format!("{parent}.rs"))]);
    let declared = parents
        .filter(|path| path.extension().is_some_and(|extension| extension == "rs") && path.is_file())
        .any(|path| {
            let text = fs::read_to_string(path).unwrap();
            declarations.iter().any(|declaration| text.contains(declaration))
        });
    declared
        || is_target(&source.path)
        || rust_sources().iter().any(|other| other.text.contains(&path_attribute))
}

/// Returns `true` if a package manifest names the file as a target, or Cargo finds it as one by its location.
fn is_target(path: &str) -> bool {
    let (package, rest) = path.split_once('/').unwrap();
    let manifest = fs::read_to_string(root().join(package).join("Cargo.toml")).unwrap();
    let is_test_target = rest.strip_prefix("tests/").is_some_and(|file| !file.contains('/'));
    manifest.contains(&format!("path = \"{rest}\"")) || is_test_target || rest.starts_with("src/bin/")
}

#[test]
fn every_other_file_is_mentioned_somewhere() {
    let paths: Vec<_> = files_below(&root()).into_iter().filter(|path| !is_output(&relative(path))).collect();
    let texts: Vec<(String, String)> = paths
        .iter()
        .filter(|path| path.metadata().unwrap().len() <= MAX_BYTES)
        .filter_map(|path| Some((relative(path), fs::read_to_string(path).ok()?)))
        .collect();
    let unused: Vec<String> = paths
        .iter()
        .map(|path| relative(path))
        .filter(|path| !path.ends_with(".rs") && !is_data_of_a_folder(path))
        .filter(|path| {
            let name = path.rsplit('/').next().unwrap();
            let stem = name.split('.').next().unwrap();
            let mentions = |text: &str| text.contains(name) || (path.ends_with(".py") && text.contains(stem));
            !FOUND_BY_NAME.contains(&name)
                && !texts.iter().any(|(other, text)| other != path && mentions(text))
        })
        .collect();
    assert_none(&unused, "every file is used by name somewhere");
}

/// Returns `true` for files that are read by folder: recorded benchmark results and test checkpoints.
fn is_data_of_a_folder(path: &str) -> bool {
    path.starts_with("benches/results/")
        || path.contains("/tests/data/")
        || path.starts_with("checkpoints/")
        || path.starts_with("python/tests/")
}

/// Returns `true` for files that runs leave in the working folder and git ignores.
fn is_output(path: &str) -> bool {
    let of_fuzzing = ["fuzz/corpus/", "fuzz/artifacts/", "fuzz/coverage/"];
    of_fuzzing.iter().any(|folder| path.starts_with(folder))
        || [".db", ".db-wal", ".db-shm", ".pending-snap"].iter().any(|ending| path.ends_with(ending))
}
