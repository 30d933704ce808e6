//! The invariants of ARCHITECTURE.md that can be read from the sources.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::path::{Path, PathBuf};

const CRATES: [&str; 6] = ["ipc-types", "sim", "policy-host", "orchestrator", "benches", "tests"];
/// Longest file that is still one idea.
const MAX_LINES: usize = 450;
/// Longest task file.
const MAX_TASK_LINES: usize = 121;

/// Path below the repository's root, and text.
struct Source {
    path: String,
    text: String,
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

fn collect(dir: &Path, extension: &str, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect(&path, extension, found);
        } else if path.extension().is_some_and(|e| e == extension) {
            found.push(path);
        }
    }
}

fn sources() -> Vec<Source> {
    let mut paths = Vec::new();
    for name in CRATES {
        collect(&root().join(name), "rs", &mut paths);
    }
    assert!(paths.len() > 50, "found only {} source files", paths.len());
    let relative = |path: &Path| path.strip_prefix(root()).unwrap().to_str().unwrap().to_owned();
    paths
        .iter()
        .map(|path| Source { path: relative(path), text: fs::read_to_string(path).unwrap() })
        .collect()
}

fn manifest(name: &str) -> String {
    fs::read_to_string(root().join(name).join("Cargo.toml")).unwrap()
}

/// The code without comments and without the unit tests at the end of a file.
fn code(source: &Source) -> String {
    let text = source.text.split("#[cfg(test)]\nmod ").next().unwrap();
    text.lines().map(|line| line.split("//").next().unwrap()).collect::<Vec<_>>().join("\n")
}

/// Fails with every place where `word` is used outside the allowed paths.
fn only_in(word: &str, allowed: &[&str], why: &str) {
    let places: Vec<String> = sources()
        .iter()
        .filter(|source| source.path != "tests/tidy.rs")
        .filter(|source| !allowed.iter().any(|prefix| source.path.starts_with(prefix)))
        .flat_map(|source| {
            let code = code(source);
            let lines: Vec<String> = (1..)
                .zip(code.lines())
                .filter(|(_, line)| line.contains(word))
                .map(|(number, line)| format!("{}:{number}: {}", source.path, line.trim()))
                .collect();
            lines
        })
        .collect();
    assert!(places.is_empty(), "`{word}` belongs only in {allowed:?} ({why}):\n{}", places.join("\n"));
}

#[test]
fn sim_and_policy_host_never_meet() {
    assert!(!manifest("sim").contains("policy-host"), "a sim must not know policies");
    assert!(!manifest("policy-host").contains("sim."), "a policy must not see privileged state");
    only_in("policy_host::", &["orchestrator/", "benches/", "tests/", "policy-host/tests/"], "invariant 1");
}

#[test]
fn ipc_types_depends_on_nothing_of_ours() {
    let manifest = manifest("ipc-types");
    for name in ["sim", "policy-host", "orchestrator"] {
        assert!(!manifest.contains(&format!("{name}.workspace")), "ipc-types depends on {name}");
    }
}

#[test]
fn each_engine_lives_behind_one_door() {
    only_in(
        "iceoryx2",
        &["ipc-types/src/link/", "ipc-types/tests/", "benches/transport"],
        "the link's only user",
    );
    only_in("rapier3d", &["sim/src/physics/", "sim/src/robot/"], "physics engine");
    only_in("wgpu", &["sim/src/render/"], "graphics API");
    only_in("faer", &["policy-host/src/nn/"], "matrix products");
    only_in("parquet::", &["orchestrator/src/demos/dataset/"], "the one writer of datasets");
    only_in("rusqlite", &["orchestrator/src/results", "tests/"], "the one writer of results");
    only_in("anyhow", &["orchestrator/", "benches/"], "below it errors have types");
}

#[test]
fn unsafe_only_where_named() {
    let allowed = [
        "ipc-types/src/layout.rs",
        "ipc-types/src/link/",
        "policy-host/src/nn/",
        "sim/src/render/cpu/isa.rs",
        "sim/src/render/cpu/simd/",
        "policy-host/tests/",
        "ipc-types/tests/",
        "sim/tests/",
        "benches/",
        "tests/",
    ];
    only_in(
        "unsafe ",
        &allowed,
        "pages are plain bytes, the link maps memory, kernels are SIMD, tests count",
    );
}

#[test]
fn no_hidden_inputs_below_the_orchestrator() {
    let outside =
        ["orchestrator/", "benches/", "tests/", "ipc-types/tests/", "policy-host/tests/", "sim/tests/"];
    only_in("env::var", &outside, "an episode depends on no environment variable");
    only_in("SystemTime", &outside, "an episode depends on no wall clock");
    only_in("thread_rng", &[], "randomness is by named stream");
    only_in("rand::", &[], "randomness is by named stream");
    let clocks =
        ["sim/src/serve/", "sim/src/render/gpu/mod.rs", "policy-host/src/serve", "ipc-types/src/link/"];
    only_in(
        "Instant::now",
        &[&clocks[..], &outside[..]].concat(),
        "clocks serve the ledger and bounded waits",
    );
}

#[test]
fn a_perturbation_is_data() {
    let in_perturb = |source: &Source| source.path.starts_with("sim/src/perturb/");
    let sources: Vec<Source> = sources().into_iter().filter(in_perturb).collect();
    assert!(!sources.is_empty());
    for word in ["Stream", "rapier", "Instant", "rand_"] {
        for source in &sources {
            assert!(!source.text.contains(word), "{} mentions {word}", source.path);
        }
    }
}

#[test]
fn a_task_is_one_short_file() {
    let mut paths = Vec::new();
    collect(&root().join("sim/src/tasks"), "rs", &mut paths);
    let list = fs::read_to_string(root().join("sim/src/tasks/mod.rs")).unwrap();
    for path in paths {
        let name = path.file_stem().unwrap().to_str().unwrap();
        if name == "mod" || path.parent().unwrap().ends_with("common") {
            continue;
        }
        let lines = fs::read_to_string(&path).unwrap().lines().count();
        assert!(lines <= MAX_TASK_LINES, "{name} has {lines} lines, at most {MAX_TASK_LINES}");
        assert!(list.contains(&format!("{name} => ")), "{name} is not in the list");
    }
}

#[test]
fn files_are_one_idea_and_say_which() {
    for source in sources() {
        let lines = source.text.lines().count();
        assert!(lines <= MAX_LINES, "{} has {lines} lines, at most {MAX_LINES}", source.path);
        assert!(source.text.starts_with("//!"), "{} does not open with what it is", source.path);
    }
}

#[test]
fn every_dependency_says_why() {
    let manifest = fs::read_to_string(root().join("Cargo.toml")).unwrap();
    let dependencies =
        manifest.split("[workspace.dependencies]").nth(1).unwrap().split("\n[").next().unwrap();
    for line in dependencies.lines().filter(|line| line.contains('=') && !line.contains("path =")) {
        assert!(line.contains(" # "), "no reason beside: {line}");
    }
}
