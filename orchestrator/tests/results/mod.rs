//! Tests of results files: storing, resuming and refusing.

use std::path::Path;

use rusqlite::Connection;
use sim::perturb::Composition;
use sim::serve::protocol::{EpisodeLedger, Outcome};
use sim::{Perturbation, TaskId};

use crate::fleet::FleetError;
use crate::plan::RunPlan;
use crate::plan::sweep::SweepArgs;
use crate::selection::condition::Condition;
use crate::store::results::episodes::*;
use crate::store::results::sealing::seal;
use crate::store::results::{EpisodeKey, Manifest, RecordedEpisodes, ResultsFile, StoreError};

const CONDITION: Condition =
    Condition { task: TaskId::RaiseCube, perturbation: Composition::single(Perturbation::None) };

fn manifest(arguments: &str) -> Manifest {
    let plan = RunPlan::new(&SweepArgs::parse(arguments).unwrap()).unwrap();
    let executions = plan.policies.iter().zip(&plan.executions);
    let identities =
        executions.map(|(policy, execution)| policy.identity(None, *execution).unwrap()).collect();
    Manifest::new(&plan, identities)
}

fn outcome(success: bool, error: Option<&str>) -> Outcome {
    Outcome {
        id: 0,
        steps: 92,
        success_once: success,
        success_at_end: success,
        first_success_step: success.then_some(40),
        failed_predicate: (!success).then(|| "above".to_owned()),
        fingerprint: 0xfeed,
        actions: None,
        ledger: EpisodeLedger::default(),
        error: error.map(str::to_owned),
    }
}

fn key(episode: u32) -> EpisodeKey<'static> {
    EpisodeKey { policy: "idle", condition: CONDITION, episode }
}

/// Returns the error of opening a results file, with its sources and without the folder.
fn refusal(path: &Path, manifest: &Manifest) -> String {
    let error = format!("{:#}", anyhow::Error::from(Results::open(path, manifest).unwrap_err()));
    error.replace(&format!("{}/", path.parent().unwrap().display()), "")
}

/// Adds one finished episode to a results file, which is created if there is none.
fn add_row(path: &Path, manifest: &Manifest) {
    Results::open(path, manifest).unwrap().record(key(0), 7, &outcome(true, None)).unwrap();
}

#[test]
fn rows_persist_and_are_resumed_and_summed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db");
    let idle = manifest("--policy idle");
    let mut results = Results::open(&path, &idle).unwrap();
    results.record(key(0), 7, &outcome(true, None)).unwrap();
    results.record(key(1), 8, &outcome(false, None)).unwrap();
    results.record(key(2), 9, &outcome(false, Some("not finite"))).unwrap();
    drop(results);

    let mut results = Results::open(&path, &idle).unwrap();
    let plan = RunPlan::new(&SweepArgs::parse("--policy idle --tasks RaiseCube").unwrap()).unwrap();
    let finished = results.finished(&plan).unwrap();
    assert_eq!([0, 1, 2, 3].map(|episode| finished.contains(0, 0, episode)), [true, true, false, false]);
    assert_eq!(finished.len(), 2);
    let sums = CellSums { n: 2, success_once: 1, success_at_end: 1, steps: 184, errors: 1 };
    assert_eq!(results.sums("idle", CONDITION, 10).unwrap(), sums);
    assert_eq!(results.sums("idle", CONDITION, 1).unwrap().n, 1);
    assert_eq!(results.sums("random", CONDITION, 10).unwrap(), CellSums::default());

    // The second try replaces an error; nothing replaces a finished row.
    results.record(key(2), 9, &outcome(true, None)).unwrap();
    results.record(key(1), 8, &outcome(true, None)).unwrap();
    let sums = CellSums { n: 3, success_once: 2, success_at_end: 2, steps: 276, errors: 0 };
    assert_eq!(results.sums("idle", CONDITION, 10).unwrap(), sums);
}

#[test]
fn columns_and_manifest_keys_are_stable() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db");
    let mut results = Results::open(&path, &manifest("--policy idle")).unwrap();
    results.record(key(0), 7, &outcome(false, None)).unwrap();
    let reader = Connection::open(&path).unwrap();
    let row: String = reader
        .query_row(
            "SELECT json_array(policy, task, perturbation, episode, seed, steps, success_once, success_at_end,
                first_success_step, failed_predicate, fingerprint, error) FROM episodes",
            [],
            |row| row.get(0),
        )
        .unwrap();
    insta::assert_snapshot!(row, @r#"["idle","RaiseCube","None",0,7,92,0,0,null,"above","000000000000feed",null]"#);
    let manifest: String = reader
        .query_row("SELECT group_concat(key || ' = ' || value, '; ') FROM manifest", [], |row| row.get(0))
        .unwrap();
    let manifest = manifest.replace(crate::store::build_identity::CODE, "CODE");
    insta::assert_snapshot!(manifest, @r#"code = "CODE"; control_mode = "pd_ee_delta_pose"; end = "horizon"; image_size = "224x224,wrist=128x128"; instructions = "act"; language = null; latency = 0; policy/idle = {"checkpoint":null,"execution":{"execute":30,"mode":"chunk"},"spec":"idle"}; profile = "strict"; protocol = "act"; seed = 0; strength = 1.0; version = "0.1.0""#);
}

#[test]
fn resume_adds_rows_but_rejects_other_options() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db");
    add_row(&path, &manifest("--policy idle"));

    let more = manifest(
        "--policy idle --policy expert --tasks StackCube --perturbations all --episodes 3 --envs 3 --threads 3 \
         --keep-actions --renderer cpu --samples 4",
    );
    Results::open(&path, &more).unwrap();

    let refused = |options: &str| refusal(&path, &manifest(&format!("--policy idle {options}")));
    insta::assert_snapshot!(refused("--seed 1"), @"failed to resume the results file a.db: seed is 0 in the file, but 1 in this command; use the same value, or another file with --db");
    insta::assert_snapshot!(refused("--profile paper"), @r#"failed to resume the results file a.db: profile is "strict" in the file, but "paper" in this command; use the same value, or another file with --db"#);
    insta::assert_snapshot!(refused("--mode ensemble"), @"failed to resume the results file a.db: policy `idle` is idle, 30 rows per query in the file, but idle, ensemble mode in this command; use the same value, or another file with --db");
    insta::assert_snapshot!(refused("--execute 8"), @"failed to resume the results file a.db: policy `idle` is idle, 30 rows per query in the file, but idle, 8 rows per query in this command; use the same value, or another file with --db");
    insta::assert_snapshot!(refused("--latency 100"), @"failed to resume the results file a.db: latency is 0 in the file, but 100 in this command; use the same value, or another file with --db");
    insta::assert_snapshot!(refused("--control-mode pd_joint_pos"), @r#"failed to resume the results file a.db: control_mode is "pd_ee_delta_pose" in the file, but "pd_joint_pos" in this command; use the same value, or another file with --db"#);
    insta::assert_snapshot!(refusal(&path, &manifest("--policy idle=random")), @"failed to resume the results file a.db: policy `idle` is idle, 30 rows per query in the file, but random, 30 rows per query in this command; use the same value, or another file with --db");
    let newer = Manifest { version: "9.9.9".to_owned(), ..manifest("--policy idle") };
    assert!(refusal(&path, &newer).contains("version is \""));
    assert!(Results::open(&path, &manifest("--policy idle")).unwrap().n_finished().unwrap() == 1);
}

#[test]
fn missing_manifest_key_means_the_default() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db");
    add_row(&path, &manifest("--policy idle"));
    let forget = |name: &str| {
        let removed = Connection::open(&path).unwrap().execute("DELETE FROM manifest WHERE key = ?1", [name]);
        assert_eq!(removed.unwrap(), 1);
    };

    forget("strength");
    insta::assert_snapshot!(refusal(&path, &manifest("--policy idle --strength 0.5")), @"failed to resume the results file a.db: strength is 1.0 in the file, but 0.5 in this command; use the same value, or another file with --db");
    assert!(Results::open(&path, &manifest("--policy idle")).unwrap().n_finished().unwrap() == 1);

    forget("version");
    insta::assert_snapshot!(refusal(&path, &manifest("--policy idle")), @"failed to resume the results file a.db: its manifest has no valid version");
}

#[test]
fn language_file_is_identified_by_its_content() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db");
    let with_language = |name: &str, text: &str| {
        let file = folder.path().join(name);
        std::fs::write(&file, text).unwrap();
        manifest(&format!("--policy idle --tasks RaiseCube --language {}", file.display()))
    };
    let first = with_language("first.yaml", "RaiseCube-v1: [lift it]");
    add_row(&path, &first);
    assert!(Results::open(&path, &with_language("copy.yaml", "RaiseCube-v1: [lift it]")).is_ok());
    let other = with_language("other.yaml", "RaiseCube-v1: [raise it]");
    assert!(refusal(&path, &other).contains("language is \""), "{}", refusal(&path, &other));
    insta::assert_snapshot!(refusal(&path, &manifest("--policy idle")), @r#"failed to resume the results file a.db: language is "5c889732c4d8cd00" in the file, but not given in this command; use the same value, or another file with --db"#);
}

#[test]
fn renderer_identity_is_stored_with_rows() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db");
    let plan = manifest("--policy idle");
    let mut results = Results::open(&path, &plan).unwrap();
    results.set_renderer("gpu (x)").unwrap();
    assert_eq!(results.renderer().unwrap(), None, "no row depends on it yet");
    results.record(key(0), 7, &outcome(true, None)).unwrap();
    drop(results);
    let again = Results::open(&path, &plan).unwrap();
    assert_eq!(again.renderer().unwrap().as_deref(), Some("gpu (x)"));
}

#[test]
fn file_without_rows_accepts_any_manifest() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db");
    Results::open(&path, &manifest("--policy idle")).unwrap();
    Results::open(&path, &manifest("--policy idle=random --seed 5")).unwrap();
}

#[test]
fn other_files_are_refused_and_unchanged() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let idle = manifest("--policy idle");

    std::fs::write(path("notes.txt"), "not a database, but long enough to be taken for a header".repeat(20))
        .unwrap();
    insta::assert_snapshot!(refusal(&path("notes.txt"), &idle), @"failed to use notes.txt as a results file: it is another kind of file; choose another, or unzip it if it is a package");
    assert!(std::fs::read_to_string(path("notes.txt")).unwrap().starts_with("not a database"));

    Connection::open(path("other.db")).unwrap().execute_batch("CREATE TABLE t (x)").unwrap();
    insta::assert_snapshot!(refusal(&path("other.db"), &idle), @"failed to use other.db as a results file: it is another kind of file; choose another, or unzip it if it is a package");

    drop(Results::open(&path("future.db"), &idle).unwrap());
    Connection::open(path("future.db")).unwrap().pragma_update(None, "user_version", 4).unwrap();
    insta::assert_snapshot!(refusal(&path("future.db"), &idle), @"failed to use the results file future.db: its tables are version 4, this program uses version 3; choose another file with --db");

    std::fs::create_dir(path("folder")).unwrap();
    insta::assert_snapshot!(refusal(&path("folder"), &idle), @"failed to open the results file folder: it is a folder; choose a file with --db");
    insta::assert_snapshot!(refusal(&path("absent/a.db"), &idle), @"failed to open the results file a.db: its folder does not exist; create it");

    let held = Results::open(&path("held.db"), &idle).unwrap();
    insta::assert_snapshot!(refusal(&path("held.db"), &idle), @"failed to use the results file held.db: another run is writing to it");
    drop(held);
    Results::open(&path("held.db"), &idle).unwrap();
}

#[test]
fn names_with_a_meaning_for_sqlite_are_files() {
    let folder = tempfile::tempdir().unwrap();
    let idle = manifest("--policy idle");
    for name in [":memory:", "file:a.db?mode=memory", "file::memory:"] {
        let path = folder.path().join(name);
        add_row(&path, &idle);
        assert!(path.is_file(), "{name}");
        assert_eq!(ResultsFile::read(&path).unwrap().rows.len(), 1, "{name}");
    }
}

#[test]
fn finished_file_needs_no_other_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db");
    add_row(&path, &manifest("--policy idle"));
    let names: Vec<_> = folder.path().read_dir().unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names, ["a.db"]);
    // Bytes 18 and 19 of a SQLite file are 2 in write-ahead mode.
    assert_eq!(std::fs::read(&path).unwrap()[18..20], [1, 1]);
}

#[test]
fn deleted_and_replaced_files_are_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db");
    let idle = manifest("--policy idle");
    for replaces in [false, true] {
        let mut results = Results::open(&path, &idle).unwrap();
        results.record(key(0), 7, &outcome(true, None)).unwrap();
        std::fs::remove_file(&path).unwrap();
        if replaces {
            std::fs::write(&path, "").unwrap();
        }
        let error = results.record(key(1), 8, &outcome(true, None)).unwrap_err();
        assert!(matches!(error, StoreError::Gone { .. }), "{error}");
    }
}

#[test]
fn damaged_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db");
    let idle = manifest("--policy idle");
    let mut results = Results::open(&path, &idle).unwrap();
    (0..400).for_each(|episode| results.record(key(episode), 7, &outcome(true, None)).unwrap());
    drop(results);
    let whole = std::fs::read(&path).unwrap();
    let mut n_refused = 0;
    for offset in (4096..whole.len()).step_by(509) {
        let mut damaged = whole.clone();
        damaged[offset..offset + 8].fill(0xff);
        std::fs::write(&path, &damaged).unwrap();
        let is_whole = Connection::open(&path)
            .and_then(|connection| {
                connection.query_row("PRAGMA integrity_check", [], |row| Ok(row.get::<_, String>(0)? == "ok"))
            })
            .unwrap_or(false);
        let [written, read] = [
            Results::open(&path, &idle).map(drop).map_err(|error| error.to_string()),
            ResultsFile::read(&path).map(drop).map_err(|error| error.to_string()),
        ];
        if !is_whole {
            n_refused += 1;
            for message in [written.unwrap_err(), read.unwrap_err()] {
                assert!(message.contains("damaged") && !message.contains('\n'), "{offset}: {message}");
            }
        }
    }
    assert!(n_refused > 5, "{n_refused} damaged files");
}

/// Found by fuzzing: such values were reported as a bug of the program.
#[test]
fn impossible_values_are_for_the_user_to_fix() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db");
    let idle = manifest("--policy idle");
    for (change, finding) in [
        ("episode = -1", "`episode` is -1, expected 0 to 4294967295"),
        ("seed = -1", "`seed` is -1, expected 0 to 9223372036854775807"),
        ("success_once = 7", "`success_once` is 7, expected 0 to 1"),
        ("success_at_end = -1", "`success_at_end` is -1, expected 0 to 1"),
        ("steps = 1e15", "`steps` is 1000000000000000, expected 0 to 100000"),
        ("first_success_step = -4", "`first_success_step` is -4"),
        ("physics_s = -0.5", "`physics_s` is -0.5 s, expected 0 to 1000000000"),
        ("wait_s = 9e999", "`wait_s` is inf s"),
        ("policy = '../x'", "`policy` is not the name of a policy"),
        ("policy = ''", "`policy` is not the name of a policy"),
        ("task = 'RaiseCub'", "RaiseCub"),
        ("perturbation = 'None+None'", "names None more than once"),
    ] {
        add_row(&path, &idle);
        let sql = format!("UPDATE episodes SET {change}");
        Connection::open(&path).unwrap().execute(&sql, []).unwrap();
        seal(&path).unwrap();
        let message = refusal(&path, &idle);
        assert!(message.contains("a.db: episode") && message.contains(finding), "{change}: {message}");
        assert!(ResultsFile::read(&path).is_err(), "{change}");
        std::fs::remove_file(&path).unwrap();
    }
}

#[test]
fn changed_values_are_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db");
    let idle = manifest("--policy idle");
    for change in [
        "policy = 'random'",
        "task = 'StackCube'",
        "perturbation = 'All'",
        "episode = 5",
        "seed = 9",
        "steps = 12",
        "success_once = 1 - success_once",
        "success_at_end = 1 - success_at_end",
        "first_success_step = 3",
        "failed_predicate = 'on'",
        "fingerprint = 'ffffffffffffffff'",
        "error = 'x'",
        "physics_s = 0.25",
        "checksum = checksum + 1",
    ] {
        add_row(&path, &idle);
        Connection::open(&path).unwrap().execute(&format!("UPDATE episodes SET {change}"), []).unwrap();
        let message = refusal(&path, &idle);
        assert!(message.contains("its checksum does not fit its values"), "{change}: {message}");
        std::fs::remove_file(&path).unwrap();
    }
}

#[test]
fn foreign_tables_views_and_triggers_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db");
    let idle = manifest("--policy idle");
    // Nobody reads the view: it would never end.
    let endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i FROM n";
    for (sql, name) in [
        (format!("ALTER TABLE episodes RENAME TO e; CREATE VIEW episodes AS {endless}"), "the table `e`"),
        (format!("CREATE VIEW v AS {endless}"), "the view `v`"),
        (
            "CREATE TRIGGER t AFTER INSERT ON episodes BEGIN DELETE FROM episodes; END".to_owned(),
            "the trigger `t`",
        ),
        ("CREATE TABLE notes (x)".to_owned(), "the table `notes`"),
        ("CREATE INDEX i ON episodes (upper(error))".to_owned(), "the index `i`"),
        ("ALTER TABLE episodes ADD COLUMN x TEXT DEFAULT 'x'".to_owned(), "the table `episodes`"),
        ("DROP TABLE manifest".to_owned(), "its table `manifest` is missing"),
    ] {
        add_row(&path, &idle);
        Connection::open(&path).unwrap().execute_batch(&sql).unwrap();
        let message = refusal(&path, &idle);
        assert!(message.contains(name) && message.contains("somebody has changed it"), "{sql}: {message}");
        assert!(ResultsFile::read(&path).is_err() && RecordedEpisodes::open(&path).is_err(), "{sql}");
        std::fs::remove_file(&path).unwrap();
    }
}

#[test]
fn vanished_rows_are_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db");
    let mut results = Results::open(&path, &manifest("--policy idle")).unwrap();
    results.record(key(0), 7, &outcome(true, None)).unwrap();
    results.record(key(1), 8, &outcome(false, None)).unwrap();
    results.check_n_finished(2).unwrap();
    Connection::open(&path).unwrap().execute("DELETE FROM episodes WHERE episode = 0", []).unwrap();
    let message = results.check_n_finished(2).unwrap_err().to_string();
    assert!(message.contains("1 finished episodes have vanished"), "{message}");
}

#[test]
fn full_disk_is_for_the_user_to_fix() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db");
    let mut results = Results::open(&path, &manifest("--policy idle")).unwrap();
    // A limit of SQLite's own gives the error of a full disk.
    results.connection.pragma_update(None, "max_page_count", 8).unwrap();
    let stored = (0..10_000).try_for_each(|episode| results.record(key(episode), 7, &outcome(true, None)));
    let error = anyhow::Error::from(stored.unwrap_err());
    let message = format!("{error:#}").replace(&format!("{}/", folder.path().display()), "");
    insta::assert_snapshot!(message, @"failed to write to the results file a.db: database or disk is full; finished episodes are stored, and the same command resumes");
    assert!(FleetError::Observer(error).is_user_error());
}

#[test]
fn lock_by_another_process_keeps_finished_episodes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.db");
    let idle = manifest("--policy idle");
    let mut results = Results::open(&path, &idle).unwrap();
    results.record(key(0), 7, &outcome(true, None)).unwrap();
    let other = Connection::open(&path).unwrap();
    other.execute_batch("BEGIN IMMEDIATE").unwrap();
    // SQLite waits for five seconds.
    let error = anyhow::Error::from(results.record(key(1), 8, &outcome(true, None)).unwrap_err());
    let message = format!("{error:#}").replace(&format!("{}/", folder.path().display()), "");
    insta::assert_snapshot!(message, @"failed to write to the results file a.db: database is locked; finished episodes are stored, and the same command resumes");
    assert!(FleetError::Observer(error).is_user_error());
    drop(results);
    drop(other);
    let mut again = Results::open(&path, &idle).unwrap();
    assert_eq!(again.n_finished().unwrap(), 1);
    again.record(key(1), 8, &outcome(true, None)).unwrap();
}

/// The journal of a transaction that was cut off says to which size the file is cut back: none.
#[test]
fn file_of_killed_creation_is_new() {
    const PAGE: u32 = 4096;
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r.db");
    let plan = manifest("--policy idle");
    drop(Results::open(&path, &plan).unwrap());
    let mut half = std::fs::read(&path).unwrap();
    half.truncate(PAGE as usize);
    // The header of an SQLite database: bytes 68 to 71 are the application id, still to be written.
    half[68..72].fill(0);
    std::fs::write(&path, half).unwrap();
    // https://www.sqlite.org/fileformat.html#the_rollback_journal
    let mut journal = vec![0xd9, 0xd5, 0x05, 0xf9, 0x20, 0xa1, 0x63, 0xd7];
    let (records, nonce, pages, sector) = (0_u32, 1_u32, 0_u32, 512_u32);
    journal.extend([records, nonce, pages, sector, PAGE].iter().flat_map(|field| field.to_be_bytes()));
    journal.resize(sector as usize, 0);
    std::fs::write(dir.path().join("r.db-journal"), journal).unwrap();
    let results = Results::open(&path, &plan).unwrap();
    assert_eq!(results.n_finished().unwrap(), 0);
}
