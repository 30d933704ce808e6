//! The invariants of ARCHITECTURE.md that can be read from the sources.

use std::fs;

use crate::source::{assert_none, files_below, manifest, relative, root, rust_sources};

/// Maximum length of a source file: a longer one holds more than one idea.
const MAX_LINES: usize = 450;
/// Maximum length of a task file.
const MAX_TASK_LINES: usize = 155;

/// Fails with every place outside the `allowed` path prefixes whose code uses `word`.
#[track_caller]
fn only_in(word: &str, allowed: &[&str], reason: &str) {
    let uses: Vec<String> = rust_sources()
        .iter()
        .filter(|source| !source.path.starts_with("tests/tidy/"))
        .filter(|source| !allowed.iter().any(|prefix| source.path.starts_with(prefix)))
        .flat_map(|source| {
            let code = source.code();
            let lines: Vec<String> = (1..)
                .zip(code.lines())
                .filter(|(_, line)| line.contains(word))
                .map(|(number, line)| format!("{}:{number}: {}", source.path, line.trim()))
                .collect();
            lines
        })
        .collect();
    assert_none(&uses, &format!("`{word}` belongs only in {allowed:?} ({reason})"));
}

#[test]
fn sim_and_policy_host_are_independent() {
    assert!(!manifest("sim").contains("policy-host"), "sim must not depend on policies");
    assert!(!manifest("policy-host").contains("sim."), "a policy must not see privileged state");
    only_in("policy_host::", &["orchestrator/", "benches/", "tests/", "policy-host/tests/"], "invariant 1");
}

#[test]
fn ipc_types_depends_on_no_other_member() {
    let manifest = manifest("ipc-types");
    for name in ["run-config", "sim", "policy-host", "orchestrator", "clap"] {
        assert!(!manifest.contains(&format!("{name}.workspace")), "ipc-types depends on {name}");
    }
}

#[test]
fn scene_and_renderer_know_no_task() {
    let dependencies = |name: &str| {
        let manifest = manifest(name);
        let after = manifest.split("[dependencies]").nth(1).unwrap();
        after.split("\n[").next().unwrap().to_owned()
    };
    for outside in ["sim.workspace", "rapier3d", "policy-host"] {
        for name in ["sim/scene", "sim/render"] {
            assert!(!dependencies(name).contains(outside), "{name} depends on {outside}");
        }
    }
    assert!(!dependencies("sim/scene").contains("ipc-types"), "a scene needs no wire format");
}

#[test]
fn each_engine_is_used_by_one_module() {
    let iceoryx_users = ["ipc-types/src/link/", "ipc-types/tests/", "benches/transport"];
    only_in("iceoryx2", &iceoryx_users, "the link is its only user");
    only_in("rapier3d", &["sim/src/physics/", "sim/src/robot/"], "physics engine");
    only_in("wgpu", &["gpu/", "sim/render/src/gpu/", "policy-host/src/nn/gpu/"], "graphics API");
    only_in("faer", &["policy-host/src/nn/"], "matrix products");
    let parquet_users = ["orchestrator/src/store/demos/dataset/", "orchestrator/src/store/parquet_table.rs"];
    only_in("parquet::", &parquet_users, "the only reader and writer of Parquet files");
    let rusqlite_users = [
        "orchestrator/src/store/results",
        "orchestrator/src/store/merging",
        "orchestrator/tests/",
        "tests/",
        "benches/conclusions",
    ];
    only_in("rusqlite", &rusqlite_users, "the only writer of results");
    only_in("anyhow", &["orchestrator/", "benches/"], "libraries have typed errors");
}

#[test]
fn results_columns_stand_in_one_list() {
    let list = "orchestrator/src/store/results/columns.rs";
    let text = fs::read_to_string(root().join(list)).unwrap();
    let declared = text.lines().filter_map(|line| line.split_once(" = \"")?.1.split('"').next());
    // Names of one word are words that other things have, too.
    let names: Vec<&str> = declared.filter(|name| name.contains('_')).collect();
    assert!(names.len() > 5, "found only the columns {names:?}");
    let tests = ["orchestrator/tests/", "orchestrator/src/study/report/tests.rs", "tests/", "benches/"];
    // What Python learns of an env has the names of the columns.
    let infos = ["python/extension/src/simulator.rs"];
    for name in names {
        only_in(&format!("\"{name}\""), &[&[list], &infos, &tests[..]].concat(), "a column is named once");
    }
    let statements =
        ["orchestrator/src/store/results/schema.rs", "orchestrator/src/store/results/manifest.rs"];
    only_in("FROM episodes", &[&statements[..], &tests[..]].concat(), "statements stand in one file");
}

#[test]
fn visibility_has_three_degrees() {
    only_in("pub(super)", &[], "pub, pub(crate) or private: other walls stand in the wrong place");
    only_in("pub(in ", &[], "pub, pub(crate) or private: other walls stand in the wrong place");
}

#[test]
fn unsafe_code_is_confined() {
    let allowed = [
        "ipc-types/src/layout.rs",
        "ipc-types/src/link/",
        "policy-host/src/nn/",
        "policy-host/src/weights/mapped.rs",
        "sim/render/src/cpu/simd/",
        "policy-host/tests/",
        "ipc-types/tests/",
        "sim/tests/",
        "benches/",
        "tests/",
    ];
    only_in(
        "unsafe ",
        &allowed,
        "pages are plain bytes, the link and large weights map memory, kernels are SIMD, tests count",
    );
}

#[test]
fn episodes_have_no_hidden_inputs() {
    let outside = [
        "orchestrator/",
        "benches/",
        "tests/",
        "gpu/tests/",
        "ipc-types/tests/",
        "policy-host/tests/",
        "sim/tests/",
    ];
    // The batch system's limits change how many threads work, never what they compute.
    let with_limits = [&outside[..], &["run-config/src/allotment.rs"]].concat();
    only_in("env::var", &with_limits, "an episode depends on no environment variable");
    // The link tells the age of what a killed process has left.
    let with_link = [&outside[..], &["ipc-types/src/link/"]].concat();
    only_in("SystemTime", &with_link, "an episode depends on no wall clock");
    only_in("thread_rng", &[], "randomness comes from named streams");
    only_in("rand::", &[], "randomness comes from named streams");
    let clocks = [
        "sim/src/serve/",
        "sim/render/src/gpu/renderer.rs",
        "policy-host/src/serve",
        "policy-host/src/nn/gemm/peak.rs",
        "ipc-types/src/link/",
    ];
    let allowed = [&clocks[..], &outside[..]].concat();
    only_in("Instant::now", &allowed, "clocks serve the ledger and bounded waits");
}

#[test]
fn perturbations_are_pure_data() {
    let in_perturb = |path: &str| path.starts_with("sim/src/perturb/");
    let sources = rust_sources();
    let sources: Vec<_> = sources.iter().filter(|source| in_perturb(&source.path)).collect();
    assert!(!sources.is_empty());
    for word in ["Stream", "rapier", "Instant", "rand_"] {
        for source in &sources {
            assert!(!source.code().contains(word), "{} mentions {word}", source.path);
        }
    }
}

#[test]
fn task_is_one_short_listed_file() {
    let list = fs::read_to_string(root().join("sim/src/tasks/mod.rs")).unwrap();
    for path in files_below(&root().join("sim/src/tasks")) {
        let name = path.file_stem().unwrap().to_str().unwrap();
        let is_shared = name == "mod" || relative(&path).contains("/common/");
        if path.extension().is_none_or(|extension| extension != "rs") || is_shared {
            continue;
        }
        let lines = fs::read_to_string(&path).unwrap().lines().count();
        assert!(lines <= MAX_TASK_LINES, "{name} has {lines} lines, at most {MAX_TASK_LINES}");
        assert!(list.contains(&format!("{name} => ")), "{name} is not in the list");
    }
}

#[test]
fn files_are_short_and_introduced() {
    for source in rust_sources() {
        let lines = source.text.lines().count();
        assert!(lines <= MAX_LINES, "{} has {lines} lines, at most {MAX_LINES}", source.path);
        assert!(source.text.starts_with("//!"), "{} does not start with a module comment", source.path);
    }
}

#[test]
fn every_dependency_states_its_reason() {
    let manifest = fs::read_to_string(root().join("Cargo.toml")).unwrap();
    let dependencies =
        manifest.split("[workspace.dependencies]").nth(1).unwrap().split("\n[").next().unwrap();
    for line in dependencies.lines().filter(|line| line.contains('=') && !line.contains("path =")) {
        assert!(line.contains(" # "), "no reason is given beside: {line}");
    }
}
