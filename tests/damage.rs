//! Messages that something else overwrites in shared memory: with `--check-frames`, no row changes.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs::OpenOptions;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::process::Child;
use std::time::{Duration, Instant};

use bytemuck::{Zeroable, bytes_of, bytes_of_mut};
use ipc_types::layout::PAGE_BYTES;
use ipc_types::{EnvRecord, Morphology};
use support::{finish, hypogeum, rows};

const EPISODES: usize = 12;
/// Time limit of a run.
const BOUND: Duration = Duration::from_secs(120);

/// Starts a run of a policy whose host spends most of the time in an answer.
fn start(dir: &Path, db: &str, extra: &[&str]) -> Child {
    let checkpoint = Path::new(env!("CARGO_MANIFEST_DIR")).join("../checkpoints/act-all");
    let policy = format!("act=act:{}", checkpoint.display());
    let episodes = EPISODES.to_string();
    let mut args = vec!["run", "--policy", &policy, "--tasks", "OpenDrawer", "--perturbations", "None"];
    args.extend(["--episodes", &episodes, "--envs", "3", "--threads", "1", "--renderer", "cpu", "--db", db]);
    args.extend(extra);
    hypogeum(dir, &args).spawn().unwrap()
}

/// Returns the files with the observations of the run in `dir`.
fn segments(dir: &Path) -> Vec<PathBuf> {
    let runs = std::fs::read_dir(dir.join("hypogeum")).into_iter().flatten().flatten();
    let names: Vec<String> = runs.map(|run| run.file_name().into_string().unwrap()).collect();
    let is_ours = |file: &String| file.ends_with(".data") && names.iter().any(|name| file.contains(name));
    support::shared_memory()
        .into_iter()
        .filter(is_ours)
        .map(|file| Path::new("/dev/shm").join(file))
        .collect()
}

/// Overwrites the state vector of every record that a segment holds, in flight or not. Returns how many.
fn overwrite_states(segment: &Path) -> usize {
    // A run that has just ended has removed the file.
    let Ok(file) = OpenOptions::new().read(true).write(true).open(segment) else { return 0 };
    let n_pages = file.metadata().unwrap().len() / PAGE_BYTES as u64;
    let mut n_overwritten = 0;
    for offset in (0..n_pages).map(|page| page * PAGE_BYTES as u64) {
        let mut record = EnvRecord::zeroed();
        if file.read_exact_at(bytes_of_mut(&mut record), offset).is_err() {
            return n_overwritten;
        }
        let is_record = record.state_dim as usize == Morphology::Single.state_dim()
            && (record.execute, record.padding) == (30, [0; 2752]);
        if is_record {
            record.state[..record.state_dim as usize].fill(0.7);
            let start = offset + std::mem::offset_of!(EnvRecord, state) as u64;
            file.write_all_at(bytes_of(&record.state), start).unwrap();
            n_overwritten += 1;
        }
    }
    n_overwritten
}

/// Overwrites observations of a run each time `is_due` says so, until the run ends.
fn overwrite_until_exit(child: &mut Child, dir: &Path, mut is_due: impl FnMut() -> bool) -> usize {
    let started = Instant::now();
    let mut n_overwritten = 0;
    while child.try_wait().unwrap().is_none() {
        if is_due() {
            n_overwritten += segments(dir).iter().map(|segment| overwrite_states(segment)).sum::<usize>();
        }
        std::thread::sleep(Duration::from_millis(2));
        assert!(started.elapsed() < BOUND, "the run does not end");
    }
    n_overwritten
}

/// Returns the number of finished episodes.
fn n_rows(db: &Path) -> usize {
    let Ok(connection) = rusqlite::Connection::open(db) else { return 0 };
    let count = |row: &rusqlite::Row<'_>| row.get::<_, i64>(0);
    connection.query_row("SELECT count(*) FROM episodes", [], count).unwrap_or(0) as usize
}

/// Starts a run of two quick policies.
fn start_quick(dir: &Path, db: &str) -> Child {
    let mut args =
        vec!["run", "--policy", "idle", "--policy", "random", "--tasks", "RaiseCube", "--envs", "8"];
    args.extend(["--episodes", "60", "--threads", "1", "--db", db]);
    hypogeum(dir, &args).spawn().unwrap()
}

/// Returns all files of the run in `dir` in shared memory, and those of its folder that have content.
fn files(dir: &Path) -> Vec<PathBuf> {
    let runs: Vec<_> = std::fs::read_dir(dir.join("hypogeum")).into_iter().flatten().flatten().collect();
    let is_ours = |file: &String| runs.iter().any(|run| file.contains(run.file_name().to_str().unwrap()));
    let segments = support::shared_memory().into_iter().filter(is_ours);
    let services =
        runs.iter().flat_map(|run| std::fs::read_dir(run.path().join("services")).into_iter().flatten());
    let segments = segments.map(|file| Path::new("/dev/shm").join(file));
    segments.chain(services.flatten().map(|entry| entry.path())).collect()
}

/// Does something to the files of a run of two quick policies, kills one of its children, and checks that the
/// rows are those of an undisturbed run.
#[track_caller]
fn check_disturbed(what: &str, victim: &str, disturb: impl Fn(&Path)) {
    let dir = tempfile::tempdir().unwrap();
    let _ = finish(start_quick(dir.path(), "reference.db")).expect_code(0);
    let db = dir.path().join("disturbed.db");
    let mut child = start_quick(dir.path(), "disturbed.db");
    assert!(support::wait_for_rows(&mut child, &db, 4), "the run ended too early");
    files(dir.path()).iter().for_each(|file| disturb(file));
    support::kill_child(support::pid_of(&child), victim);
    let finished = finish(child).expect_code(0);
    assert!(finished.stderr.contains(what), "{victim}: {}", finished.stderr);
    assert_eq!(rows(&db), rows(&dir.path().join("reference.db")), "{victim}: {}", finished.stderr);
    assert_eq!(files(dir.path()), Vec::<PathBuf>::new());
}

#[test]
fn removed_shared_memory_is_replaced() {
    for victim in ["policy-host", "sim"] {
        check_disturbed("RemoveIPC in logind.conf", victim, |file| {
            let _ = std::fs::remove_file(file);
        });
    }
}

#[test]
fn overwritten_management_segments_are_replaced() {
    for victim in ["policy-host", "sim"] {
        check_disturbed("continuing under other names", victim, |file| {
            let kind = file.extension().and_then(|kind| kind.to_str()).unwrap_or_default();
            if ["dynamic", "connection", "event_mgmt"].contains(&kind) {
                let length = std::fs::metadata(file).unwrap().len();
                let segment = OpenOptions::new().write(true).open(file).unwrap();
                segment.write_all_at(&vec![0xff; length as usize], 0).unwrap();
            }
        });
    }
}

#[test]
fn overwritten_observations_change_no_row() {
    let dir = tempfile::tempdir().unwrap();
    let _ = finish(start(dir.path(), "reference.db", &[])).expect_code(0);
    let expected = rows(&dir.path().join("reference.db"));
    assert_eq!(expected.len(), EPISODES);

    // Without checksums, they change rows in silence.
    let mut child = start(dir.path(), "silent.db", &[]);
    assert!(overwrite_until_exit(&mut child, dir.path(), || true) > 0);
    let _ = finish(child).expect_code(0);
    assert_ne!(rows(&dir.path().join("silent.db")), expected);

    // Once per finished episode, so that the policy is not given up.
    let db = dir.path().join("checked.db");
    let mut child = start(dir.path(), "checked.db", &["--check-frames"]);
    let mut n_finished = 0;
    let overwritten = overwrite_until_exit(&mut child, dir.path(), || {
        let before = std::mem::replace(&mut n_finished, n_rows(&db));
        n_finished > before
    });
    let finished = finish(child).expect_code(0);
    assert!(overwritten > 0);
    assert!(finished.stderr.contains("overwritten in shared memory"), "{}", finished.stderr);
    assert_eq!(rows(&db), expected, "{}", finished.stderr);
}
