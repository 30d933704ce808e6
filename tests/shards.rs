//! Sweeps that are cut into shards: whatever their number, and whatever happens to their tasks, the merged
//! rows are those of one run; `merge` finds rows that differ.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;
use std::process::Child;
use std::time::{Duration, Instant};

use rustix::process::{Signal, kill_process};
use support::{FinishedRun, Row, act_tiny, finish, hypogeum, n_rows, pid_of, rows, run};

/// The sweep of these tests: two policies of very different costs, both morphologies, two conditions.
fn sweep(episodes: &str) -> Vec<String> {
    let act = format!("act=act:{}", act_tiny());
    let words = ["run", "--policy", "random", "--policy", &act, "--tasks", "RaiseCube,DualArmLiftTray"];
    let more = [
        "--perturbations",
        "None,Camera-Pose",
        "--episodes",
        episodes,
        "--envs",
        "4",
        "--threads",
        "1",
        "--quiet",
    ];
    words.iter().chain(&more).map(|word| (*word).to_owned()).collect()
}

fn start(dir: &Path, db: &str, episodes: &str, more: &[&str]) -> Child {
    let words = sweep(episodes);
    let args: Vec<&str> =
        words.iter().map(String::as_str).chain(["--db", db]).chain(more.iter().copied()).collect();
    let mut command = hypogeum(dir, &args);
    // Tasks keep their files until they are saved on a disk of the node.
    command.env("TMPDIR", dir).spawn().unwrap()
}

fn shard(dir: &Path, db: &str, shard: &str, more: &[&str]) -> FinishedRun {
    finish(start(dir, db, "6", &[&["--shard", shard], more].concat()))
}

fn merge(dir: &Path, args: &[&str]) -> FinishedRun {
    run(dir, &[&["merge"], args].concat())
}

fn whole_rows(dir: &Path, episodes: &str) -> Vec<Row> {
    let _ = finish(start(dir, "whole.db", episodes, &[])).expect_code(0);
    rows(&dir.join("whole.db"))
}

/// Returns the file of a running shard on this node, when it exists.
fn scratch_file(dir: &Path) -> std::path::PathBuf {
    let deadline = Instant::now() + Duration::from_secs(60);
    loop {
        let names = std::fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().path());
        let is_scratch = |path: &std::path::PathBuf| {
            path.file_name().unwrap().to_string_lossy().starts_with("hypogeum-")
                && path.extension().is_some_and(|it| it == "db")
        };
        if let Some(path) = names.into_iter().find(is_scratch) {
            return path;
        }
        assert!(Instant::now() < deadline, "no task has begun");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn wait_for_episodes(dir: &Path, n: usize) {
    let path = scratch_file(dir);
    let deadline = Instant::now() + Duration::from_secs(60);
    while n_rows(&path) < n {
        assert!(Instant::now() < deadline, "the shard has no {n} episodes");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn rows_do_not_depend_on_shards() {
    let dir = tempfile::tempdir().unwrap();
    let expected = whole_rows(dir.path(), "6");
    for (n, audit) in [(1, &[][..]), (3, &["--audit", "20%"][..]), (5, &["--costs", "whole.db"][..])] {
        let db = format!("{n}.db");
        // Shards finish in any order.
        for index in (0..n).rev() {
            let _ = shard(dir.path(), &db, &format!("{index}/{n}"), audit).expect_code(0);
        }
        let folder = format!("{n}.shards");
        let merged = merge(dir.path(), &[&db, &folder]).expect_code(0);
        assert!(
            merged.stdout.contains(&format!("{} of them new, from {n} file", expected.len())),
            "{}",
            merged.stdout
        );
        assert_eq!(merged.stdout.contains("agree in every column"), n == 3, "{}", merged.stdout);
        assert_eq!(rows(&dir.path().join(&db)), expected, "{n} shards");
        let before = std::fs::read(dir.path().join(&db)).unwrap();
        let again = merge(dir.path(), &[&db, &folder]).expect_code(0);
        assert!(again.stdout.contains("nothing new"), "{}", again.stdout);
        assert!(std::fs::read(dir.path().join(&db)).unwrap() == before, "the file has changed");
        let compared =
            run(dir.path(), &["compare", &folder, "--a", "random", "--b", "act", "--json"]).expect_code(0);
        assert!(compared.stdout.contains("\"cells\""));
        let verified = run(dir.path(), &["verify", &folder, "--sample", "5", "--quiet"]).expect_code(0);
        assert!(verified.stderr.contains("5 of 5 episodes agree"), "{}", verified.stderr);
    }
}

#[test]
fn killed_and_interrupted_tasks_resume() {
    let dir = tempfile::tempdir().unwrap();
    let expected = whole_rows(dir.path(), "40");
    let begin = || start(dir.path(), "s.db", "40", &["--shard", "1/2"]);
    let folder = dir.path().join("s.shards");
    let killed = begin();
    wait_for_episodes(dir.path(), 5);
    kill_process(pid_of(&killed), Signal::KILL).unwrap();
    let _ = finish(killed);
    // The file of the killed task is still on this node.
    let interrupted = begin();
    wait_for_episodes(dir.path(), 10);
    kill_process(pid_of(&interrupted), Signal::TERM).unwrap();
    let interrupted = finish(interrupted).expect_code(130);
    assert!(!interrupted.stderr.contains("(0 of "), "{}", interrupted.stderr);
    let saved = n_rows(&folder.join("shard-1-of-2.db"));
    assert!(saved >= 10, "{saved} episodes are saved");
    let state = std::fs::read_to_string(folder.join("shard-1-of-2.json")).unwrap();
    assert!(state.contains("\"phase\":\"interrupted\""), "{state}");
    let merged = merge(dir.path(), &["s.db", "s.shards"]).expect_code(1);
    assert!(
        merged.stdout.contains("missing:")
            && merged.stdout.contains("to run just what is missing: hypogeum run")
    );
    let resumed = finish(begin()).expect_code(0);
    assert!(resumed.stderr.contains(&format!("({saved} of ")), "{}", resumed.stderr);
    let _ = finish(start(dir.path(), "s.db", "40", &["--shard", "0/2"])).expect_code(0);
    let _ = merge(dir.path(), &["s.db", "s.shards"]).expect_code(0);
    assert_eq!(rows(&dir.path().join("s.db")), expected);
    let left: Vec<_> =
        std::fs::read_dir(dir.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(!left.iter().any(|name| name.to_string_lossy().starts_with("hypogeum-")), "{left:?}");
}

#[test]
fn merge_finds_an_altered_row() {
    let dir = tempfile::tempdir().unwrap();
    for index in 0..2 {
        let _ = shard(dir.path(), "s.db", &format!("{index}/2"), &["--audit", "50%"]).expect_code(0);
    }
    let second = dir.path().join("s.shards/shard-1-of-2.db");
    let connection = rusqlite::Connection::open(&second).unwrap();
    let first = dir.path().join("s.shards/shard-0-of-2.db");
    connection.execute("ATTACH ?1 AS other", [first.to_str().unwrap()]).unwrap();
    // An episode that both have.
    let changed = connection
        .execute(
            "UPDATE episodes SET fingerprint = '0123456789abcdef' WHERE (policy, task, perturbation, episode) = \
             (SELECT policy, task, perturbation, episode FROM episodes JOIN other.episodes USING \
             (policy, task, perturbation, episode) LIMIT 1)",
            [],
        )
        .unwrap();
    assert_eq!(changed, 1);
    drop(connection);
    let edited = merge(dir.path(), &["s.db", "s.shards"]).expect_code(2);
    assert!(edited.stderr.contains("its checksum does not fit its values"), "{}", edited.stderr);
    orchestrator::fuzzing::seal_results(&second);
    let differing = merge(dir.path(), &["s.db", "s.shards"]).expect_code(1);
    assert!(
        differing.stdout.contains("fingerprint  ") && differing.stdout.contains("0123456789abcdef"),
        "{}",
        differing.stdout
    );
    assert!(differing.stdout.contains("Nothing was written"), "{}", differing.stdout);
    assert!(!dir.path().join("s.db").exists());
}

#[test]
fn two_tasks_cannot_run_one_shard() {
    let dir = tempfile::tempdir().unwrap();
    let begin = || start(dir.path(), "s.db", "100000", &["--shard", "0/2"]);
    // Neither sees the other when it begins.
    let mut tasks = [begin(), begin()];
    wait_for_episodes(dir.path(), 1);
    let third = finish(begin()).expect_code(2);
    assert!(third.stderr.contains("shard 0/2 is being run by process"), "{}", third.stderr);
    let running = usize::from(tasks[0].try_wait().unwrap().is_some());
    kill_process(pid_of(&tasks[running]), Signal::TERM).unwrap();
    let codes = tasks.map(|task| finish(task).status.code());
    assert!(codes == [Some(2), Some(130)] || codes == [Some(130), Some(2)], "{codes:?}");
}

#[test]
fn shards_of_different_sweeps_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let _ = shard(dir.path(), "s.db", "0/2", &[]).expect_code(0);
    let refused = |shard_arg: &str, more: &[&str], reason: &str| {
        let refused = shard(dir.path(), "s.db", shard_arg, more).expect_code(2);
        assert!(refused.stderr.contains(reason), "{}", refused.stderr);
    };
    refused("2/2", &[], "there are 2 shards, numbered from 0 to 1; found 2");
    refused("0/3", &[], "the number of shards is 3 here, but 2 there");
    refused("1/2", &["--seed", "7"], "seed is 7 here, but 0 there");
    refused("1/2", &["--audit", "1%"], "--audit is 0.01 here, but 0 there");
    refused("1/2", &["--scratch", "/nowhere"], "name a folder on a disk of this node with --scratch");
    refused("auto", &[], "--shard auto found none of SLURM_ARRAY_TASK_ID");
    let _ = shard(dir.path(), "t.db", "1/2", &["--seed", "7"]).expect_code(0);
    let mixed = merge(dir.path(), &["m.db", "s.shards", "t.shards"]).expect_code(2);
    assert!(mixed.stderr.contains("seed is 0 in the first and 7 in the second"), "{}", mixed.stderr);
    let path = dir.path().join("s.shards/shard-0-of-2.db");
    let whole = std::fs::read(&path).unwrap();
    for length in [whole.len() / 2, 4096, 100, 0] {
        std::fs::write(&path, &whole[..length]).unwrap();
        let cut = merge(dir.path(), &["m.db", "s.shards"]).expect_code(2);
        assert!(cut.stderr.contains("shard-0-of-2.db"), "{}", cut.stderr);
    }
    assert!(!dir.path().join("m.db").exists());
}
