//! Crash safety: a killed child costs only its unfinished episodes, an interrupted run resumes to the same
//! rows, and no shared memory is left behind.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;
use std::process::Child;
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

use rustix::process::{Signal, kill_process};
use support::{
    FinishedRun, Row, act_tiny, children, finish, hypogeum, kill_child, n_rows, pid_of, rows, run,
    shared_memory, wait_for_rows,
};

/// Serialises the tests, so that leftovers in /dev/shm can be attributed to one of them.
static SERIAL: Mutex<()> = Mutex::new(());

/// The exclusive right to run, and the segments that were in /dev/shm when it was obtained.
struct Turn {
    before: Vec<String>,
    _guard: MutexGuard<'static, ()>,
}

impl Turn {
    fn begin() -> Self {
        let guard = SERIAL.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        Self { before: shared_memory(), _guard: guard }
    }

    /// Returns the segments created since the turn began. Other runs on this machine may have left some
    /// before.
    fn leftovers(&self) -> Vec<String> {
        let mut names = shared_memory();
        names.retain(|name| !self.before.contains(name));
        names
    }
}

/// Tasks of both morphologies; more of them would only take longer.
const TASKS: &str = "RaiseCube,StackCube,DualArmLiftTray";

fn arguments(db: &str) -> Vec<String> {
    let act = format!("act=act:{}", act_tiny());
    let words = ["run", "--policy", "expert", "--policy", "random", "--policy", &act, "--tasks", TASKS];
    let more = ["--perturbations", "none", "--episodes", "6", "--envs", "6", "--threads", "2", "--db", db];
    words.iter().chain(&more).chain(&["--check-frames"]).map(|word| (*word).to_owned()).collect()
}

fn start(dir: &Path, db: &str) -> Child {
    let args = arguments(db);
    hypogeum(dir, &args.iter().map(String::as_str).collect::<Vec<_>>()).spawn().unwrap()
}

fn uninterrupted_rows(dir: &Path) -> Vec<Row> {
    let _ = finish(start(dir, "reference.db")).expect_code(0);
    rows(&dir.join("reference.db"))
}

/// Returns `true` if this process has not exited. A zombie has.
fn is_alive(pid: &str) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    stat.rsplit_once(") ").is_some_and(|(_, rest)| !rest.starts_with(['Z', 'X']))
}

#[test]
fn killed_children_and_resume_change_no_row() {
    let turn = Turn::begin();
    let dir = tempfile::tempdir().unwrap();
    let expected = uninterrupted_rows(dir.path());
    let db = dir.path().join("killed.db");
    let mut child = start(dir.path(), "killed.db");
    for (rows, victim) in [(4, "sim"), (12, "policy-host"), (20, "sim"), (28, "policy-host")] {
        assert!(wait_for_rows(&mut child, &db, rows), "the run ended before a child could be killed");
        kill_child(pid_of(&child), victim);
    }
    assert!(wait_for_rows(&mut child, &db, 36), "the run ended before it could be interrupted");
    kill_process(pid_of(&child), Signal::INT).unwrap();
    let interrupted = finish(child);
    let n_kept = n_rows(&db);
    let FinishedRun { stderr, .. } = finish(start(dir.path(), "killed.db")).expect_code(0);
    assert!(n_kept >= 36, "kept {n_kept} rows: {}", interrupted.stderr);
    assert_eq!(rows(&db), expected, "{stderr}");
    assert_eq!(turn.leftovers(), Vec::<String>::new());
}

#[test]
fn killed_host_of_two_networks_changes_no_row() {
    let turn = Turn::begin();
    let dir = tempfile::tempdir().unwrap();
    let checkpoint = ["checkpoint", "-o", "pi05", "--kind", "pi05", "--size", "tiny"];
    let _ = run(dir.path(), &checkpoint).expect_code(0);
    let act = format!("act=act:{}", act_tiny());
    let start = |db| {
        let mut args = vec!["run", "--policy", &act, "--policy", "vla=pi05:pi05"];
        args.extend(["--tasks", "RaiseCube,StackCube", "--perturbations", "None,Language-Paraphrase"]);
        args.extend(["--episodes", "4", "--envs", "6", "--threads", "2", "--db", db]);
        hypogeum(dir.path(), &args).spawn().unwrap()
    };
    let _ = finish(start("reference.db")).expect_code(0);
    let db = dir.path().join("killed.db");
    let mut child = start("killed.db");
    for n in [4, 12] {
        assert!(wait_for_rows(&mut child, &db, n), "the run ended before a host could be killed");
        kill_child(pid_of(&child), "policy-host");
    }
    let FinishedRun { stderr, .. } = finish(child).expect_code(0);
    let found = rows(&db);
    assert_eq!(found.len(), 2 * 2 * 2 * 4);
    assert_eq!(found, rows(&dir.path().join("reference.db")), "{stderr}");
    assert!(stderr.contains("state unpadded in the prompt"), "{stderr}");
    assert_eq!(turn.leftovers(), Vec::<String>::new());
}

#[test]
fn killed_orchestrator_leaves_a_resumable_file() {
    let turn = Turn::begin();
    let dir = tempfile::tempdir().unwrap();
    let expected = uninterrupted_rows(dir.path());
    let db = dir.path().join("orphaned.db");
    let mut child = start(dir.path(), "orphaned.db");
    assert!(wait_for_rows(&mut child, &db, 5));
    child.kill().unwrap();
    let _ = finish(child);
    let _ = finish(start(dir.path(), "orphaned.db")).expect_code(0);
    assert_eq!(rows(&db), expected);
    assert_eq!(turn.leftovers(), Vec::<String>::new(), "the next run should remove stale segments");
}

/// The children of a killed orchestrator exit by themselves, whatever they are doing, and the last of them
/// removes the run's shared memory.
#[test]
fn killed_orchestrator_leaves_no_process() {
    let turn = Turn::begin();
    let dir = tempfile::tempdir().unwrap();
    for delay_ms in [2, 5, 10, 20, 40, 80, 160, 320, 640] {
        let mut child = start(dir.path(), &format!("{delay_ms}.db"));
        std::thread::sleep(Duration::from_millis(delay_ms));
        let orphans = children(pid_of(&child));
        child.kill().unwrap();
        let _ = finish(child);
        let deadline = Instant::now() + Duration::from_secs(30);
        while orphans.iter().any(|pid| is_alive(pid)) || !turn.leftovers().is_empty() {
            assert!(Instant::now() < deadline, "{delay_ms} ms: {orphans:?} or {:?} stay", turn.leftovers());
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

#[test]
fn finished_run_repeats_only_the_report() {
    let turn = Turn::begin();
    let dir = tempfile::tempdir().unwrap();
    let args = ["run", "--policy", "idle", "--tasks", "RaiseCube", "--episodes", "2", "--db", "r.db"];
    let _ = run(dir.path(), &args).expect_code(0);
    let before = rows(&dir.path().join("r.db"));
    let again = run(dir.path(), &args).expect_code(0);
    assert_eq!(rows(&dir.path().join("r.db")), before);
    assert!(again.stdout.contains("RaiseCube"), "the table should be printed again: {}", again.stdout);
    assert_eq!(turn.leftovers(), Vec::<String>::new());
}
