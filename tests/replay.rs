//! Replay of a results file from its recorded actions.

use std::fs;
use std::path::Path;

use rusqlite::Connection;
use support::run;

const ACT: &str = concat!("act=act:", env!("CARGO_MANIFEST_DIR"), "/../policy-host/tests/data/act-tiny");

/// Evaluates several kinds of policies on a single-arm and a bimanual task.
fn evaluate(folder: &Path, db: &str, more: &[&str]) {
    let args =
        ["run", "--policy", "idle", "--policy", "random", "--policy", "expert", "--policy", ACT, "--db", db];
    let tasks =
        ["--tasks", "RaiseCube,DualArmDrawerOpen", "--perturbations", "None,Camera-Pose", "--episodes", "2"];
    run(folder, &[&args[..], &tasks, more].concat()).expect_code(0);
}

#[test]
fn recorded_actions_reproduce_their_episodes() {
    let dir = tempfile::tempdir().unwrap();
    evaluate(dir.path(), "all.db", &[]);
    let all = run(dir.path(), &["replay", "all.db"]).expect_code(0);
    assert!(all.stderr.contains("32 of 32 episodes reproduce"), "{}", all.stderr);
    let some = ["--policy", "act", "--task", "RaiseCube", "--perturbation", "Camera-Pose"];
    let some = run(dir.path(), &[&["replay", "all.db"][..], &some].concat()).expect_code(0);
    assert!(some.stderr.contains("2 of 2 episodes reproduce"), "{}", some.stderr);
    let movie = ["replay", "all.db", "--policy", "expert", "--task", "RaiseCube", "--movie", "raise.gif"];
    run(dir.path(), &movie).expect_code(0);
    assert!(fs::read(dir.path().join("raise.gif")).unwrap().starts_with(b"GIF89a"));

    // Overwrite the random policy's actions with zeros.
    let database = Connection::open(dir.path().join("all.db")).unwrap();
    let changed = database
        .execute(
            "UPDATE episodes SET actions = zeroblob(length(actions)) WHERE policy = 'random' AND episode = 1",
            [],
        )
        .unwrap();
    assert_eq!(changed, 4);
    drop(database);
    let message = run(dir.path(), &["replay", "all.db"]).expect_code(2).stderr;
    assert!(message.contains("the checksum of the stored actions of"), "{message}");
    orchestrator::fuzzing::seal_results(&dir.path().join("all.db"));
    let all = run(dir.path(), &["replay", "all.db"]).expect_code(1);
    assert!(all.stderr.contains("28 of 32 episodes reproduce"), "{}", all.stderr);
}

#[test]
fn unreplayable_source_is_rejected() {
    let dir = tempfile::tempdir().unwrap();
    let rejected = |args: &[&str], words: &[&str]| {
        let finished = run(dir.path(), &[&["replay"], args].concat()).expect_code(2);
        for word in words {
            assert!(finished.stderr.contains(word), "`{word}` is missing in: {}", finished.stderr);
        }
    };
    let idle = ["run", "--policy", "idle", "--tasks", "RaiseCube", "--episodes", "1"];
    run(dir.path(), &[&idle[..], &["--db", "bare.db", "--keep-actions=false"]].concat()).expect_code(0);
    rejected(&["bare.db"], &["bare.db has no recorded actions", "--keep-actions"]);
    run(dir.path(), &[&idle[..], &["--db", "kept.db"]].concat()).expect_code(0);
    rejected(&["kept.db", "--episodes", "1"], &["has 1 episodes", "episode 1 was requested"]);
    rejected(&["kept.db", "--policy", "expert"], &["none of the 1 episodes"]);
    rejected(&["kept.db", "--task", "RaiseCub"], &["unknown task", "RaiseCube"]);
    let database = Connection::open(dir.path().join("kept.db")).unwrap();
    database.execute("UPDATE episodes SET actions = zeroblob(12)", []).unwrap();
    orchestrator::fuzzing::seal_results(&dir.path().join("kept.db"));
    drop(database);
    rejected(&["kept.db"], &["idle's RaiseCube None", "has 1 values", "expected 644"]);
    fs::write(dir.path().join("notes.txt"), "no database").unwrap();
    rejected(&["notes.txt"], &["notes.txt", "another kind of file"]);
    rejected(&["nowhere"], &["nowhere contains no dataset"]);
}

/// A demonstration of the original on RaiseCube, with its start state.
const DEMONSTRATION: &str =
    concat!(env!("CARGO_MANIFEST_DIR"), "/../sim/tests/data/trajectories/RaiseCube-v1.0.json");

#[test]
fn demonstration_of_the_original_succeeds_from_its_start() {
    let dir = tempfile::tempdir().unwrap();
    let replay = ["replay", "--start", DEMONSTRATION, "--actions", DEMONSTRATION];
    let text = run(dir.path(), &replay).expect_code(0).stdout;
    assert!(text.starts_with("RaiseCube, pd_joint_pos: 73 steps, success at step"), "{text}");
    let json = run(dir.path(), &[&replay[..], &["--json"]].concat()).expect_code(0).stdout;
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["steps"].as_array().unwrap().len(), 73);
    assert_eq!(json["success_at_end"], true);
    let last = &json["steps"][72];
    assert_eq!(last["arms"][0]["grasps"][0], "cube");
    assert!(last["bodies"]["cube"]["pose"][2].as_f64().unwrap() > 0.2);
    run(dir.path(), &[&replay[..], &["--movie", "raise.gif", "--stride", "20"]].concat()).expect_code(0);
    assert!(fs::read(dir.path().join("raise.gif")).unwrap().starts_with(b"GIF89a"));

    fs::write(dir.path().join("bad.json"), r#"{"actions": [[0, 0]]}"#).unwrap();
    let bad = run(dir.path(), &["replay", "--start", DEMONSTRATION, "--actions", "bad.json"]).expect_code(2);
    assert!(bad.stderr.contains("bad.json: actions[0]: expected 8 numbers, found 2"), "{}", bad.stderr);
    let bad = run(dir.path(), &["replay", "--start", "bad.json", "--actions", DEMONSTRATION]).expect_code(2);
    assert!(bad.stderr.contains("bad.json is not a trajectory"), "{}", bad.stderr);
    let _ = run(dir.path(), &["replay", "--start", DEMONSTRATION]).expect_code(2);
}
