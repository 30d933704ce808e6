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
    evaluate(dir.path(), "all.db", &["--keep-actions"]);
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
    run(dir.path(), &[&idle[..], &["--db", "bare.db"]].concat()).expect_code(0);
    rejected(&["bare.db"], &["bare.db has no recorded actions", "--keep-actions"]);
    run(dir.path(), &[&idle[..], &["--db", "kept.db", "--keep-actions"]].concat()).expect_code(0);
    rejected(&["kept.db", "--episodes", "1"], &["has 1 episodes", "episode 1 was requested"]);
    rejected(&["kept.db", "--policy", "expert"], &["none of the 1 episodes"]);
    rejected(&["kept.db", "--task", "RaiseCub"], &["unknown task", "RaiseCube"]);
    let database = Connection::open(dir.path().join("kept.db")).unwrap();
    database.execute("UPDATE episodes SET actions = x'00000000'", []).unwrap();
    drop(database);
    rejected(&["kept.db"], &["idle's RaiseCube None", "has 1 values", "expected 644"]);
    fs::write(dir.path().join("notes.txt"), "no database").unwrap();
    rejected(&["notes.txt"], &["notes.txt", "another kind of file"]);
    rejected(&["nowhere"], &["nowhere contains no dataset"]);
}
