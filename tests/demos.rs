//! Demonstration datasets: byte-identical however they were produced, and replayable bit for bit.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use support::{hypogeum, run};

/// Two single-arm tasks and one bimanual task.
const TASKS: &str = "RaiseCube,OpenDrawer,DualArmDrawerOpen";

fn demos<'a>(folder: &'a str, others: &[&'a str]) -> Vec<&'a str> {
    let args = ["demos", "-o", folder, "--tasks", TASKS, "--episodes", "2"];
    args.into_iter().chain(others.iter().copied()).collect()
}

/// Returns the contents of every file below `folder`, by relative path.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if path.is_dir() {
            found.extend(files(&path).into_iter().map(|(inner, bytes)| (format!("{name}/{inner}"), bytes)));
        } else {
            found.insert(name, fs::read(path).unwrap());
        }
    }
    found
}

#[test]
fn resumed_dataset_is_byte_identical() {
    let dir = tempfile::tempdir().unwrap();
    let whole = run(dir.path(), &demos("whole", &["--threads", "1"])).expect_code(0);
    assert!(whole.stdout.contains("DualArmDrawerOpen"), "{}", whole.stdout);

    let mut child = hypogeum(dir.path(), &demos("killed", &["--threads", "2"])).spawn().unwrap();
    let first_file = dir.path().join("killed/single/data/chunk-000/file-000.parquet");
    let started = Instant::now();
    while !first_file.exists() && started.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(first_file.exists(), "no data file was written within a minute");
    run(dir.path(), &demos("killed", &["--threads", "2"])).expect_code(0);

    let [whole, killed] = ["whole", "killed"].map(|folder| files(&dir.path().join(folder)));
    let names = |files: &BTreeMap<String, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&whole), names(&killed));
    assert!(names(&whole).contains(&"bimanual/meta/tasks.parquet".to_owned()), "{:?}", names(&whole));
    for (name, bytes) in &whole {
        assert!(killed[name] == *bytes, "{name} differs");
    }
    let again = run(dir.path(), &demos("whole", &[])).expect_code(0);
    assert!(
        again.stderr.contains(", 0.0 new ones per second"),
        "existing episodes should not be recorded again: {}",
        again.stderr
    );
}

#[test]
fn replay_detects_a_changed_fingerprint() {
    let dir = tempfile::tempdir().unwrap();
    run(dir.path(), &demos("demos", &["--images", "png"])).expect_code(0);
    for (morphology, n) in [("single", 4), ("bimanual", 2)] {
        let replayed = run(dir.path(), &["replay", &format!("demos/{morphology}")]).expect_code(0);
        assert!(replayed.stderr.contains(&format!("{n} of {n} episodes reproduce")), "{}", replayed.stderr);
    }
    run(dir.path(), &["replay", "demos/single", "--episodes", "3", "--movie", "three.gif"]).expect_code(0);
    assert!(fs::read(dir.path().join("three.gif")).unwrap().starts_with(b"GIF89a"));

    let journal = dir.path().join("demos/single/meta/hypogeum.jsonl");
    let text = fs::read_to_string(&journal).unwrap();
    let at = text.find("\"fingerprint\":\"").unwrap() + "\"fingerprint\":\"".len();
    let other = if text[at..].starts_with('0') { "1" } else { "0" };
    fs::write(&journal, format!("{}{other}{}", &text[..at], &text[at + 1..])).unwrap();
    let replayed = run(dir.path(), &["replay", "demos/single"]).expect_code(1);
    assert!(replayed.stderr.contains("3 of 4 episodes reproduce"), "{}", replayed.stderr);
}

#[test]
fn options_that_contradict_the_dataset_are_rejected() {
    let dir = tempfile::tempdir().unwrap();
    let rejected = |args: &[&str], words: &[&str]| {
        let finished = run(dir.path(), args).expect_code(2);
        for word in words {
            assert!(finished.stderr.contains(word), "`{word}` is missing in: {}", finished.stderr);
        }
    };
    let demos = |others: &[&'static str]| -> Vec<&'static str> {
        let args = ["demos", "-o", "demos", "--tasks", "RaiseCube", "--episodes", "1"];
        args.into_iter().chain(others.iter().copied()).collect()
    };
    run(dir.path(), &demos(&[])).expect_code(0);
    rejected(&demos(&["--seed", "5"]), &["hypogeum.json", "seed is 1000", "5"]);
    rejected(&demos(&["--images", "png"]), &["images is \"jpeg\"", "\"png\""]);
    rejected(&demos(&["--shrink", "2"]), &["shrink is 1", "2"]);
    rejected(&demos(&["--images", "gif"]), &["--images", "jpeg, png"]);
    rejected(&demos(&["--control-mode", "pd_ee_pose"]), &["pd_ee_pose", "pd_joint_pos"]);
    rejected(&demos(&["--perturbation", "RO-Color"]), &["RO-Color", "RaiseCube"]);
    rejected(&["replay", "demos/single", "--episodes", "1"], &["has 1 episodes", "episode 1 was requested"]);
    rejected(&["replay", "demos"], &["contains no dataset", "meta/hypogeum.json"]);
    let data = dir.path().join("demos/single/data/chunk-000/file-000.parquet");
    let bytes = fs::read(&data).unwrap();
    fs::write(&data, &bytes[..bytes.len() / 2]).unwrap();
    rejected(&["replay", "demos/single"], &["file-000.parquet", "episode 0"]);
    fs::write(dir.path().join("demos/single/meta/hypogeum.jsonl"), "{}\n").unwrap();
    rejected(&["replay", "demos/single"], &["hypogeum.jsonl", "line 1"]);
    fs::create_dir_all(dir.path().join("other/single")).unwrap();
    fs::write(dir.path().join("other/single/mine.txt"), "mine").unwrap();
    rejected(&["demos", "-o", "other", "--tasks", "RaiseCube"], &["other/single", "not empty"]);
}
