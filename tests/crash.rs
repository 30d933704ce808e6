//! A killed child costs only its unfinished episodes; an interrupted run resumes to the same rows; nothing stays behind.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;
use std::process::Child;
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use support::{Finished, Row, act_tiny, finish, hypogeum, rows, run, shared_memory};

/// One run at a time, so that what is left in /dev/shm has one owner.
static ALONE: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    ALONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// One arm and two: more tasks would only take longer.
const TASKS: &str = "RaiseCube,StackCube,DualArmLiftTray";

fn arguments(db: &str) -> Vec<String> {
    let act = format!("act=act:{}", act_tiny());
    let words = ["run", "--policy", "expert", "--policy", "random", "--policy", &act, "--tasks", TASKS];
    let more = ["--perturbations", "none", "--episodes", "6", "--envs", "6", "--threads", "2", "--db", db];
    words.iter().chain(&more).map(|word| (*word).to_owned()).collect()
}

fn start(dir: &Path, db: &str) -> Child {
    let args = arguments(db);
    hypogeum(dir, &args.iter().map(String::as_str).collect::<Vec<_>>()).spawn().unwrap()
}

fn undisturbed(dir: &Path) -> Vec<Row> {
    let _ = finish(start(dir, "reference.db")).expect_code(0);
    rows(&dir.join("reference.db"))
}

fn pid_of(child: &Child) -> Pid {
    Pid::from_child(child)
}

/// A child process of `parent` whose command line has this word.
fn find_child(parent: Pid, word: &str) -> Option<Pid> {
    let path = format!("/proc/{0}/task/{0}/children", parent.as_raw_nonzero());
    let children = std::fs::read_to_string(path).ok()?;
    children.split_whitespace().find_map(|pid| {
        let line = std::fs::read(format!("/proc/{pid}/cmdline")).ok()?;
        let has_word = line.split(|byte| *byte == 0).any(|arg| arg == word.as_bytes());
        has_word.then(|| Pid::from_raw(pid.parse().ok()?)).flatten()
    })
}

/// Finished episodes so far.
fn n_rows(db: &Path) -> usize {
    let Ok(connection) = rusqlite::Connection::open(db) else { return 0 };
    connection.query_row("SELECT count(*) FROM episodes", [], |row| row.get::<_, i64>(0)).unwrap_or(0)
        as usize
}

/// Waits until the run has at least `n` rows; false if it ended before.
fn wait_for_rows(child: &mut Child, db: &Path, n: usize) -> bool {
    let deadline = Instant::now() + Duration::from_secs(120);
    while n_rows(db) < n {
        if child.try_wait().unwrap().is_some() {
            return false;
        }
        assert!(Instant::now() < deadline, "no {n} rows within two minutes");
        std::thread::sleep(Duration::from_millis(5));
    }
    true
}

/// Kills the child with this subcommand, waiting for it to exist.
fn kill_child(parent: Pid, word: &str) {
    let deadline = Instant::now() + Duration::from_secs(60);
    loop {
        if let Some(pid) = find_child(parent, word) {
            kill_process(pid, Signal::KILL).unwrap();
            return;
        }
        assert!(Instant::now() < deadline, "the run has no `{word}` child");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn children_killed_twice_and_a_resume_change_no_row() {
    let _guard = alone();
    let dir = tempfile::tempdir().unwrap();
    let expected = undisturbed(dir.path());
    let db = dir.path().join("killed.db");
    let mut child = start(dir.path(), "killed.db");
    for (rows, victim) in [(4, "sim"), (12, "policy-host"), (20, "sim"), (28, "policy-host")] {
        assert!(wait_for_rows(&mut child, &db, rows), "the run ended before it could be disturbed");
        kill_child(pid_of(&child), victim);
    }
    assert!(wait_for_rows(&mut child, &db, 36), "the run ended before it could be interrupted");
    kill_process(pid_of(&child), Signal::INT).unwrap();
    let interrupted = finish(child);
    let kept = n_rows(&db);
    let Finished { stderr, .. } = finish(start(dir.path(), "killed.db")).expect_code(0);
    assert!(kept >= 36, "kept {kept} rows: {}", interrupted.stderr);
    assert_eq!(rows(&db), expected, "{stderr}");
    assert_eq!(shared_memory(), Vec::<String>::new());
}

#[test]
fn an_orchestrator_killed_outright_leaves_a_file_that_resumes() {
    let _guard = alone();
    let dir = tempfile::tempdir().unwrap();
    let expected = undisturbed(dir.path());
    let db = dir.path().join("orphaned.db");
    let mut child = start(dir.path(), "orphaned.db");
    assert!(wait_for_rows(&mut child, &db, 5));
    child.kill().unwrap();
    let _ = finish(child);
    let _ = finish(start(dir.path(), "orphaned.db")).expect_code(0);
    assert_eq!(rows(&db), expected);
    assert_eq!(shared_memory(), Vec::<String>::new(), "the next run sweeps what the killed one left");
}

#[test]
fn a_finished_run_has_nothing_left_to_do() {
    let _guard = alone();
    let dir = tempfile::tempdir().unwrap();
    let args = ["run", "--policy", "idle", "--tasks", "RaiseCube", "--episodes", "2", "--db", "r.db"];
    let _ = run(dir.path(), &args).expect_code(0);
    let before = rows(&dir.path().join("r.db"));
    let again = run(dir.path(), &args).expect_code(0);
    assert_eq!(rows(&dir.path().join("r.db")), before);
    assert!(again.stdout.contains("RaiseCube"), "the table is printed again: {}", again.stdout);
    assert_eq!(shared_memory(), Vec::<String>::new());
}
