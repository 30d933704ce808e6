//! Determinism: rows and fingerprints depend neither on the number of envs nor on the number of threads.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use support::{Row, act_tiny, rows, run};

/// Evaluates three policies in a temporary folder and returns the rows.
fn run_with(tasks: &str, perturbations: &str, extra: &[&str]) -> Vec<Row> {
    let dir = tempfile::tempdir().unwrap();
    let act = format!("act=act:{}", act_tiny());
    let mut args = vec!["run", "--policy", "expert", "--policy", "random", "--policy", &act];
    args.extend(["--tasks", tasks, "--perturbations", perturbations]);
    args.extend(["--episodes", "1", "--seed", "7", "--check-frames", "--db", "r.db"]);
    args.extend(extra);
    let _ = run(dir.path(), &args).expect_code(0);
    rows(&dir.path().join("r.db"))
}

#[test]
fn rows_are_independent_of_envs_and_threads() {
    let run = |extra| run_with("all", "None,All", extra);
    let alone = run(&["--envs", "1"]);
    assert_eq!(alone.len(), 3 * sim::TaskId::ALL.len() * 2);
    assert_eq!(alone, run(&["--envs", "7", "--threads", "1"]));
    assert_eq!(alone, run(&[]), "envs and threads are chosen during the run");
}

#[test]
fn perturbed_rows_are_independent_of_envs_and_threads() {
    let perturbations =
        ["Light-Color", "Distractor-Objects", "Language-Random", "MO-Size", "Camera-Pose+MO-Texture"];
    let run = |extra| run_with("RaiseCube,DualArmLiftTray", &perturbations.join(","), extra);
    let alone = run(&["--envs", "1"]);
    assert_eq!(alone.len(), 3 * 2 * perturbations.len());
    assert_eq!(alone, run(&["--envs", "7", "--threads", "1"]));
    assert_eq!(alone, run(&["--envs", "32", "--threads", "2"]));
}

#[test]
fn ensemble_rows_are_independent_of_envs_and_threads() {
    let with = |extra: &[&str]| {
        let dir = tempfile::tempdir().unwrap();
        let act = format!("act=act:{}", act_tiny());
        let mut args = vec!["run", "--policy", &act, "--tasks", "RaiseCube", "--perturbations", "none"];
        args.extend(["--episodes", "3", "--mode", "ensemble", "--db", "r.db"]);
        args.extend(extra);
        let _ = run(dir.path(), &args).expect_code(0);
        rows(&dir.path().join("r.db"))
    };
    let alone = with(&["--envs", "1"]);
    assert_eq!(alone.len(), 3);
    assert_eq!(alone, with(&["--envs", "3", "--threads", "2"]));
}

#[test]
fn pi05_rows_are_independent_of_envs_and_threads() {
    let dir = tempfile::tempdir().unwrap();
    let checkpoint = ["checkpoint", "-o", "pi05", "--kind", "pi05", "--size", "tiny"];
    let _ = run(dir.path(), &checkpoint).expect_code(0);
    let with = |db: &str, extra: &[&str]| {
        let mut args = vec!["run", "--policy", "a=pi05:pi05?steps=4", "--policy", "b=pi05-int8:pi05"];
        args.extend(["--tasks", "RaiseCube", "--perturbations", "None,Language-Random", "--episodes", "4"]);
        args.extend(["--db", db]);
        args.extend(extra);
        let done = run(dir.path(), &args).expect_code(0);
        #[cfg(target_arch = "x86_64")]
        assert_eq!(
            done.stderr.contains("policy `b`: 8-bit inference is slower"),
            !std::arch::is_x86_feature_detected!("avx512vnni"),
        );
        rows(&dir.path().join(db))
    };
    let alone = with("1.db", &["--envs", "1"]);
    assert_eq!(alone.len(), 2 * 2 * 4);
    assert_eq!(alone, with("2.db", &["--envs", "5", "--threads", "1"]));
    assert_eq!(alone, with("3.db", &["--envs", "16", "--threads", "2"]));
}

#[test]
fn different_seeds_give_different_trajectories() {
    let fingerprints = |seed| {
        let dir = tempfile::tempdir().unwrap();
        let args = [
            "run",
            "--policy",
            "random",
            "--tasks",
            "RaiseCube",
            "--episodes",
            "2",
            "--seed",
            seed,
            "--db",
            "r.db",
        ];
        let _ = run(dir.path(), &args).expect_code(0);
        rows(&dir.path().join("r.db")).into_iter().map(|row| row[10].clone()).collect::<Vec<_>>()
    };
    let (first, second) = (fingerprints("1"), fingerprints("2"));
    assert!(first.iter().all(|fingerprint| !second.contains(fingerprint)), "{first:?} and {second:?}");
}
