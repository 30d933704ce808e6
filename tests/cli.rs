//! What a user may get wrong: one clear error each, exit code 2, and nothing lost.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::path::Path;

use support::{act_tiny, rows, run};

/// Runs, expects exit code 2 and one error that has all of `words`.
#[track_caller]
fn refused(dir: &Path, args: &[&str], words: &[&str]) {
    let finished = run(dir, args).expect_code(2);
    let errors: Vec<&str> = finished.stderr.lines().filter(|line| line.starts_with("error")).collect();
    assert_eq!(errors.len(), 1, "one error: {}", finished.stderr);
    for word in words {
        assert!(finished.stderr.contains(word), "`{word}` is missing in: {}", finished.stderr);
    }
    assert!(!finished.stderr.contains("panicked"), "{}", finished.stderr);
}

#[test]
fn unknown_names_are_met_with_near_ones() {
    let dir = tempfile::tempdir().unwrap();
    refused(dir.path(), &["run", "--policy", "idle", "--tasks", "RaiseCub"], &["RaiseCub", "RaiseCube"]);
    let args = ["run", "--policy", "idle", "--tasks", "RaiseCube", "--perturbations", "MO-Colour"];
    refused(dir.path(), &args, &["MO-Colour", "MO-Color"]);
    refused(dir.path(), &["run", "--policy", "idel", "--tasks", "RaiseCube"], &["idel", "idle"]);
}

#[test]
fn a_sweep_file_with_an_unknown_key_names_it() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("sweep.toml"), "tasks = [\"RaiseCube\"]\nepisode = 3\n").unwrap();
    refused(dir.path(), &["run", "sweep.toml"], &["sweep.toml", "episode"]);
    refused(dir.path(), &["run", "absent.toml"], &["absent.toml"]);
}

/// A copy of the tiny checkpoint in `dir`.
fn copy_checkpoint(dir: &Path) {
    for morphology in ["single", "bimanual"] {
        let (from, to) = (Path::new(&act_tiny()).join(morphology), dir.join("act").join(morphology));
        fs::create_dir_all(&to).unwrap();
        for file in fs::read_dir(from).unwrap() {
            let file = file.unwrap();
            fs::copy(file.path(), to.join(file.file_name())).unwrap();
        }
    }
}

#[test]
fn a_bad_checkpoint_is_refused_before_anything_starts() {
    let dir = tempfile::tempdir().unwrap();
    copy_checkpoint(dir.path());
    let args = ["run", "--policy", "a=act:act", "--tasks", "RaiseCube", "--episodes", "1"];
    let weights = dir.path().join("act/single/model.safetensors");
    let whole = fs::read(&weights).unwrap();
    fs::write(&weights, &whole[..whole.len() / 2]).unwrap();
    refused(dir.path(), &args, &["model.safetensors"]);
    fs::write(&weights, b"{}").unwrap();
    refused(dir.path(), &args, &["model.safetensors"]);
    fs::remove_file(&weights).unwrap();
    refused(dir.path(), &args, &["model.safetensors"]);
    refused(dir.path(), &["run", "--policy", "a=act:nowhere", "--tasks", "RaiseCube"], &["nowhere"]);
}

#[test]
fn a_checkpoint_drives_in_the_mode_it_was_trained_for() {
    let dir = tempfile::tempdir().unwrap();
    copy_checkpoint(dir.path());
    let config = dir.path().join("act/single/config.json");
    let text = fs::read_to_string(&config).unwrap();
    assert!(text.contains("pd_ee_delta_pose"), "{text}");
    fs::write(&config, text.replace("pd_ee_delta_pose", "pd_ee_pose")).unwrap();
    let args = ["run", "--policy", "a=act:act", "--tasks", "RaiseCube", "--episodes", "1", "--db", "x.db"];
    refused(dir.path(), &args, &["single robot by pd_ee_pose", "run by pd_ee_delta_pose"]);
    run(dir.path(), &[&args[..], &["--control-mode", "pd_ee_pose"]].concat()).expect_code(0);
    assert_eq!(rows(&dir.path().join("x.db")).len(), 1);
}

#[test]
fn too_little_shared_memory_is_seen_before_it_is_taken() {
    let dir = tempfile::tempdir().unwrap();
    // Each policy that looks at images takes 2 GB at the largest number of envs: enough of them for any /dev/shm.
    let free = rustix::fs::statvfs("/dev/shm").unwrap();
    let n_policies = free.f_blocks * free.f_frsize / 2_000_000_000 + 1;
    let policies: Vec<String> = (0..n_policies).map(|i| format!("a{i}=act:{}", act_tiny())).collect();
    let mut args = vec!["run", "--tasks", "RaiseCube", "--episodes", "1", "--envs", "4096"];
    policies.iter().for_each(|policy| args.extend(["--policy", policy]));
    refused(dir.path(), &args, &["/dev/shm", "--envs"]);
}

#[test]
fn a_file_of_another_kind_or_configuration_is_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    let run_into = |db: &'static str, seed: &'static str| {
        ["run", "--policy", "idle", "--tasks", "RaiseCube", "--episodes", "1", "--db", db, "--seed", seed]
    };
    fs::write(dir.path().join("notes.txt"), "these are notes, not results").unwrap();
    refused(dir.path(), &run_into("notes.txt", "0"), &["notes.txt"]);
    assert_eq!(fs::read_to_string(dir.path().join("notes.txt")).unwrap(), "these are notes, not results");

    let other = rusqlite::Connection::open(dir.path().join("other.db")).unwrap();
    other.execute_batch("CREATE TABLE episodes (name TEXT); PRAGMA user_version = 99;").unwrap();
    drop(other);
    refused(dir.path(), &run_into("other.db", "0"), &["other.db"]);

    let _ = run(dir.path(), &run_into("mine.db", "0")).expect_code(0);
    let before = rows(&dir.path().join("mine.db"));
    refused(dir.path(), &run_into("mine.db", "1"), &["mine.db", "seed"]);
    assert_eq!(rows(&dir.path().join("mine.db")), before);
}

#[test]
fn the_suite_is_listed() {
    let dir = tempfile::tempdir().unwrap();
    let listed = run(dir.path(), &["tasks"]).expect_code(0);
    let matrix = run(dir.path(), &["tasks", "--matrix"]).expect_code(0);
    for task in sim::TaskId::ALL {
        assert!(
            listed.stdout.contains(task.name()) && matrix.stdout.contains(task.name()),
            "{}",
            task.name()
        );
    }
    for perturbation in sim::Perturbation::ALL {
        assert!(matrix.stdout.contains(perturbation.name()), "{}", perturbation.name());
    }
    let json = run(dir.path(), &["tasks", "--json"]).expect_code(0);
    let value: serde_json::Value = serde_json::from_str(&json.stdout).unwrap();
    assert!(value.to_string().contains("RaiseCube"));
}

#[test]
fn json_is_one_object_on_stdout() {
    let dir = tempfile::tempdir().unwrap();
    let args =
        ["run", "--policy", "idle", "--tasks", "RaiseCube", "--episodes", "2", "--db", "r.db", "--json"];
    let finished = run(dir.path(), &args).expect_code(0);
    let value: serde_json::Value = serde_json::from_str(&finished.stdout).unwrap();
    let cell = &value["cells"][0];
    assert_eq!((cell["n"].as_u64(), cell["success_once"].as_f64()), (Some(2), Some(0.0)), "{cell}");
    assert!(value["fps"]["env_steps_per_s"].as_f64().unwrap() > 0.0);
    assert!(value["run"].is_object() && value["ledger"].is_object());
}

#[test]
fn show_writes_a_picture() {
    let dir = tempfile::tempdir().unwrap();
    let _ = run(dir.path(), &["show", "RaiseCube", "-o", "x.png"]).expect_code(0);
    let png = fs::read(dir.path().join("x.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG") && png.len() > 20_000, "{} bytes", png.len());
    refused(dir.path(), &["show", "RaiseCube", "-o", "absent/x.png"], &["absent/x.png"]);
}
