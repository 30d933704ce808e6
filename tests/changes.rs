//! Files that change during a run: no row depends on what was there at the start and on what is there later.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};

use support::{
    Row, act_tiny, find_child, finish, hypogeum, hypogeum_at, kill_child, pid_of, program, rows,
    wait_for_rows,
};

const TASKS: &str = "RaiseCube,StackCube";
const N_ROWS: usize = 2 * 12;

/// Copies a checkpoint folder for one robot into `dir`, and returns the path of its weights.
fn copy_checkpoint(from: &str, dir: &Path) -> PathBuf {
    std::fs::create_dir(dir).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, dir.join(path.file_name().unwrap())).unwrap();
    }
    dir.join("model.safetensors")
}

fn arguments<'a>(policy: &'a str, db: &'a str) -> Vec<&'a str> {
    let mut args = vec!["run", "--policy", policy, "--tasks", TASKS, "--perturbations", "none"];
    args.extend(["--episodes", "12", "--envs", "3", "--threads", "1", "--db", db]);
    args
}

fn start(dir: &Path, policy: &str, db: &str) -> Child {
    hypogeum(dir, &arguments(policy, db)).spawn().unwrap()
}

/// Overwrites the second half of a weights file, which holds only numbers, with zeros.
fn overwrite(path: &Path) {
    let file = std::fs::OpenOptions::new().write(true).open(path).unwrap();
    let size = file.metadata().unwrap().len();
    file.write_all_at(&vec![0; (size / 2) as usize], size - size / 2).unwrap();
}

/// Asserts that the run ends because `checkpoint` has changed, and that all its rows are among `expected`.
fn assert_ends(run: Child, db: &Path, checkpoint: &Path, expected: &[Row]) {
    let stderr = finish(run).expect_code(2).stderr;
    let checkpoint = checkpoint.file_name().unwrap().to_str().unwrap();
    for words in [checkpoint, "has changed during the run: its content hash was", "at the start and is"] {
        assert!(stderr.contains(words), "{words}: {stderr}");
    }
    let found = rows(db);
    assert!(found.len() < N_ROWS, "the checkpoint changed too late");
    for row in found {
        assert!(expected.contains(&row), "{row:?}");
    }
}

#[test]
fn restarted_host_refuses_another_checkpoint() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("act");
    let weights = copy_checkpoint(&format!("{}/single", act_tiny()), &folder);
    let start = |db| start(dir.path(), "act=act:act", db);
    let _ = finish(start("reference.db")).expect_code(0);
    let db = dir.path().join("changed.db");
    let mut child = start("changed.db");
    assert!(wait_for_rows(&mut child, &db, 4), "the run ended before its checkpoint could change");
    let new = dir.path().join("new.safetensors");
    std::fs::copy(&weights, &new).unwrap();
    overwrite(&new);
    std::fs::rename(&new, &weights).unwrap();
    kill_child(pid_of(&child), "policy-host");
    assert_ends(child, &db, &folder, &rows(&dir.path().join("reference.db")));
}

#[test]
fn weights_overwritten_in_place_end_the_run() {
    const PI05: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../checkpoints/pi05-all/single");
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("pi05");
    let weights = copy_checkpoint(PI05, &folder);
    let start = |db| start(dir.path(), "vla=pi05:pi05?steps=1", db);
    let _ = finish(start("reference.db")).expect_code(0);
    let db = dir.path().join("changed.db");
    let mut child = start("changed.db");
    assert!(wait_for_rows(&mut child, &db, 4), "the run ended before its checkpoint could change");
    overwrite(&weights);
    assert_ends(child, &db, &folder, &rows(&dir.path().join("reference.db")));
}

/// As after a rebuild during a run.
#[test]
fn replaced_program_goes_on_as_before() {
    let dir = tempfile::tempdir().unwrap();
    let act = format!("act=act:{}", act_tiny());
    let _ = finish(start(dir.path(), &act, "reference.db")).expect_code(0);
    let copy = dir.path().join("copy");
    // By another process: this one may be starting a child, which would hold the file open for writing.
    assert!(Command::new("cp").arg(program()).arg(&copy).status().unwrap().success());
    let db = dir.path().join("replaced.db");
    let mut child = hypogeum_at(&copy, dir.path(), &arguments(&act, "replaced.db")).spawn().unwrap();
    let wait = |child: &mut Child, n| {
        assert!(wait_for_rows(child, &db, n), "the run ended before a child could be killed");
    };
    wait(&mut child, 4);
    std::fs::write(dir.path().join("new"), "not a program").unwrap();
    std::fs::rename(dir.path().join("new"), &copy).unwrap();
    kill_child(pid_of(&child), "policy-host");
    wait(&mut child, 8);
    std::fs::remove_file(&copy).unwrap();
    kill_child(pid_of(&child), "sim");
    wait(&mut child, 12);
    let sim = find_child(pid_of(&child), "sim").unwrap();
    let name = std::fs::read_to_string(format!("/proc/{}/comm", sim.as_raw_nonzero())).unwrap();
    assert_eq!(name.trim_end(), "hypogeum-sim");
    let stderr = finish(child).expect_code(0).stderr;
    assert_eq!(stderr.matches("restarting it").count(), 2, "{stderr}");
    assert_eq!(rows(&db), rows(&dir.path().join("reference.db")));
}
