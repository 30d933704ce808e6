//! The bundled checkpoints: their sizes, their success on two tasks, and whether they read their instruction.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::path::Path;

use serde_json::Value;
use support::run;

const ACT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../checkpoints/act-all");
const PI05: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../checkpoints/pi05-all");
/// One task per morphology on which both checkpoints nearly always succeed.
const TASKS: &str = "PickDishFromRack,DualArmPushBox";

fn bytes_below(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.map(|path| if path.is_dir() { bytes_below(&path) } else { path.metadata().unwrap().len() }).sum()
}

/// Evaluates policies on `TASKS`. Returns (policy, perturbation, `success_once`) of every cell.
fn success(options: &[&str]) -> Vec<(String, String, f64)> {
    let dir = tempfile::tempdir().unwrap();
    let finished = run(dir.path(), &[&["run", "--tasks", TASKS, "--json"], options].concat()).expect_code(0);
    let report: Value = serde_json::from_str(&finished.stdout).unwrap();
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    let cells = report["cells"].as_array().unwrap().iter();
    cells
        .map(|cell| {
            (text(&cell["policy"]), text(&cell["perturbation"]), cell["success_once"].as_f64().unwrap())
        })
        .collect()
}

#[test]
fn bundled_checkpoints_are_small() {
    let bytes = [ACT, PI05].map(|checkpoint| bytes_below(Path::new(checkpoint)));
    assert!(bytes.iter().all(|bytes| *bytes > 1 << 20), "{bytes:?} bytes");
    assert!(bytes.iter().sum::<u64>() < 40_000_000, "{bytes:?} bytes");
}

#[test]
fn act_succeeds_where_idle_fails() {
    let act = format!("act=act:{ACT}");
    let cells = success(&["--policy", "idle", "--policy", &act, "--episodes", "5", "--execute", "15"]);
    assert_eq!(cells.len(), 4);
    for (policy, _, success) in cells {
        let expected = if policy == "act" { success >= 0.6 } else { success == 0.0 };
        assert!(expected, "{policy} {success}");
    }
}

#[test]
fn pi05_succeeds_only_with_its_instruction() {
    let pi05 = format!("pi05=pi05:{PI05}");
    let perturbations = "None,Language-Other-Task";
    let options = ["--policy", &pi05, "--perturbations", perturbations, "--episodes", "6"];
    let cells = success(&options);
    assert_eq!(cells.len(), 4);
    for (_, perturbation, success) in cells {
        let expected = if perturbation == "None" { success >= 0.6 } else { success == 0.0 };
        assert!(expected, "{perturbation} {success}");
    }
}
