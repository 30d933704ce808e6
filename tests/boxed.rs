//! The bundled checkpoint `checkpoints/act-small`: its size and its success on two tasks.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::path::Path;

use support::run;

const CHECKPOINT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../checkpoints/act-small");
/// One task per morphology on which the checkpoint nearly always succeeds.
const TASKS: &str = "PickDishFromRack,DualArmPushBox";
const EPISODES: &str = "5";

fn bytes_below(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.map(|path| if path.is_dir() { bytes_below(&path) } else { path.metadata().unwrap().len() }).sum()
}

#[test]
fn bundled_checkpoint_is_small() {
    let bytes = bytes_below(Path::new(CHECKPOINT));
    assert!((1 << 20..30_000_000).contains(&bytes), "{bytes} bytes");
}

#[test]
fn bundled_checkpoint_succeeds_where_idle_fails() {
    let dir = tempfile::tempdir().unwrap();
    let act = format!("act=act:{CHECKPOINT}");
    let policies = ["run", "--policy", "idle", "--policy", &act, "--tasks", TASKS, "--episodes", EPISODES];
    let finished = run(dir.path(), &[&policies[..], &["--execute", "15", "--json"]].concat()).expect_code(0);
    let report: serde_json::Value = serde_json::from_str(&finished.stdout).unwrap();
    let cells = report["cells"].as_array().unwrap();
    assert_eq!(cells.len(), 4);
    for cell in cells {
        let success = cell["success_once"].as_f64().unwrap();
        let expected = if cell["policy"] == "act" { success >= 0.6 } else { success == 0.0 };
        assert!(expected, "{cell}");
    }
}
