//! Policies on a GPU, here a software Vulkan driver: rows do not depend on the batch, and a results file
//! never mixes devices.

use std::path::Path;

use support::{FinishedRun, act_tiny, rows, run};

const TASKS: &str = "RaiseCube,DualArmLiftTray";

fn evaluate(dir: &Path, db: &str, extra: &[&str]) -> FinishedRun {
    let act = format!("act=act:{}", act_tiny());
    let mut args =
        vec!["run", "--policy", &act, "--policy", "idle", "--tasks", TASKS, "--perturbations", "None"];
    args.extend(["--episodes", "2", "--check-frames", "--verbose", "--db", db]);
    if !extra.contains(&"--renderer") {
        args.extend(["--renderer", "cpu"]);
    }
    args.extend(extra);
    run(dir, &args)
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn results_depend_on_device_but_not_batch() {
    let dir = tempfile::tempdir().unwrap();
    let software = ["--policy-device", "software"];
    let first = evaluate(dir.path(), "1.db", &[&software[..], &["--envs", "1"]].concat()).expect_code(0);
    let line = first.stdout.lines().find(|line| line.starts_with("device "));
    assert!(line.is_some_and(|line| line.contains(" policies ")), "{}", first.stdout);
    let alone = rows(&dir.path().join("1.db"));
    assert_eq!(alone.len(), 2 * 2 * 2);
    let _ = evaluate(dir.path(), "4.db", &[&software[..], &["--envs", "4"]].concat()).expect_code(0);
    assert_eq!(rows(&dir.path().join("4.db")), alone);

    // A file knows its device and its renderer, and verification returns to both.
    let refused = evaluate(dir.path(), "4.db", &["--policy-device", "cpu"]).expect_code(2);
    assert!(refused.stderr.contains(" on software: "), "{}", refused.stderr);
    let verified = run(dir.path(), &["verify", "4.db"]).expect_code(0);
    assert!(verified.stderr.contains("8 of 8 episodes agree"), "{}", verified.stderr);
    let drawn = ["--renderer", "software", "--policy-device", "cpu"];
    let drawn = evaluate(dir.path(), "drawn.db", &drawn).expect_code(0);
    assert!(drawn.stdout.contains("\ndevice           rendering "), "{}", drawn.stdout);
    let verified = run(dir.path(), &["verify", "drawn.db"]).expect_code(0);
    assert!(verified.stderr.contains("8 of 8 episodes agree"), "{}", verified.stderr);
    let cpu = evaluate(dir.path(), "cpu.db", &["--policy-device", "cpu"]).expect_code(0);
    assert!(!cpu.stderr.contains("software"), "{}", cpu.stderr);
    let refused = evaluate(dir.path(), "cpu.db", &software);
    assert!(refused.expect_code(2).stderr.contains(" on software: "));
}

/// π0.5's prompts differ in length from sample to sample.
#[test]
#[ignore = "needs a Vulkan driver"]
fn pi05_on_device_does_not_depend_on_batch() {
    const PI05: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../policy-host/tests/data/pi05/robot");
    let dir = tempfile::tempdir().unwrap();
    let evaluate = |db: &str, envs: &str| {
        let policy = format!("pi05=pi05:{PI05}?steps=2");
        let args = ["run", "--policy", &policy, "--tasks", "RaiseCube", "--perturbations", "None"];
        let options = ["--policy-device", "software", "--episodes", "4", "--execute", "10"];
        run(dir.path(), &[&args[..], &options, &["--renderer", "cpu", "--db", db, "--envs", envs]].concat())
    };
    let _ = evaluate("1.db", "1").expect_code(0);
    let alone = rows(&dir.path().join("1.db"));
    assert_eq!(alone.len(), 4);
    let _ = evaluate("4.db", "4").expect_code(0);
    assert_eq!(rows(&dir.path().join("4.db")), alone);
}

#[test]
fn policies_without_gpu_kernels_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let int8 = format!("act-int8:{}", act_tiny());
    let args = ["run", "--policy", &int8, "--tasks", "RaiseCube", "--policy-device", "software"];
    let refused = run(dir.path(), &args).expect_code(2);
    for words in [&int8, "computes on the CPU only", "--policy-device cpu"] {
        assert!(refused.stderr.contains(words), "{}", refused.stderr);
    }
}

#[test]
fn missing_devices_are_named() {
    let dir = tempfile::tempdir().unwrap();
    for options in
        [&["--policy-device", "software"][..], &["--policy-device", "cpu", "--renderer", "software"]]
    {
        let refused = evaluate(dir.path(), "missing.db", &[options, &["--gpu", "9"]].concat());
        assert!(refused.stderr.contains("found no software Vulkan driver 9"), "{}", refused.stderr);
        let _ = refused.expect_code(2);
    }
    let refused = evaluate(dir.path(), "missing.db", &["--gpu", "9"]).expect_code(2);
    assert!(
        refused.stderr.contains("found no GPU 9"),
        "an explicit number is not ignored: {}",
        refused.stderr
    );
}
