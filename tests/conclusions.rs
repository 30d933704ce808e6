//! Conclusions from results: comparing, reporting, verifying, stopping early, and charged latency.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;

use serde_json::Value;
use support::{FinishedRun, act_tiny, rows, run};

/// Evaluates the expert and the idle policy on two tasks, four episodes each, into `r.db`.
fn evaluate(dir: &Path, extra: &[&str]) {
    let mut args = vec!["run", "--policy", "expert", "--policy", "idle", "--tasks", "RaiseCube,OpenDrawer"];
    args.extend(["--perturbations", "None,Light-Color", "--episodes", "4", "--db", "r.db"]);
    args.extend(extra);
    let _ = run(dir, &args).expect_code(0);
}

fn json(run: &FinishedRun) -> Value {
    serde_json::from_str(&run.stdout).unwrap()
}

/// Changes a results file as somebody would who also writes its checksums anew.
fn sql(db: &Path, statement: &str) {
    rusqlite::Connection::open(db).unwrap().execute_batch(statement).unwrap();
    orchestrator::fuzzing::seal_results(db);
}

/// Asserts that a command fails with exit code 2 and one line that contains `parts`, and returns the line.
#[track_caller]
fn refuses(dir: &Path, args: &[&str], parts: &[&str]) {
    let refused = run(dir, args).expect_code(2);
    let message = refused.stderr.trim_end();
    assert_eq!(message.lines().count(), 1, "{message}");
    for part in parts {
        assert!(message.contains(part), "{message} should contain {part}");
    }
}

#[test]
fn compare_finds_the_better_policy() {
    let dir = tempfile::tempdir().unwrap();
    evaluate(dir.path(), &[]);
    let compared = run(dir.path(), &["compare", "r.db", "--a", "expert", "--b", "idle", "--json"]);
    let compared = json(&compared.expect_code(0));
    let cells = compared["cells"].as_array().unwrap();
    assert_eq!(cells.len(), 4);
    for cell in cells {
        assert_eq!(
            (&cell["n"], &cell["successes"][0], &cell["successes"][1]),
            (&4.into(), &4.into(), &0.into())
        );
        assert_eq!(cell["p"], 0.0625);
    }
    assert_eq!(compared["groups"][0]["mean"], 1.0);
    assert_eq!(compared["flips"].as_array().unwrap().len(), 16);
    let text = run(dir.path(), &["compare", "r.db", "--a", "expert", "--b", "idle", "--flips", "1"]);
    let text = text.expect_code(0).stdout;
    // The command that it prints shows the failing episode.
    let command = text.lines().find(|line| line.contains("hypogeum replay")).unwrap();
    let words: Vec<&str> = command.split("hypogeum ").nth(1).unwrap().split_whitespace().collect();
    let _ = run(dir.path(), &words).expect_code(0);
    assert!(dir.path().join("flip.gif").exists());
    let own = json(&run(dir.path(), &["compare", "r.db", "--policy", "expert", "--json"]).expect_code(0));
    assert_eq!((own["cells"].as_array().unwrap().len(), &own["groups"][0]["mean"]), (2, &0.0.into()));
}

#[test]
fn files_are_compared_only_if_results_agree() {
    let dir = tempfile::tempdir().unwrap();
    evaluate(dir.path(), &[]);
    let other = ["run", "--policy", "more=random", "--tasks", "RaiseCube", "--episodes", "2"];
    let _ = run(dir.path(), &[&other[..], &["--db", "same.db"]].concat()).expect_code(0);
    let _ = run(dir.path(), &[&other[..], &["--db", "late.db", "--latency", "100"]].concat()).expect_code(0);
    let _ = run(dir.path(), &[&other[..], &["--db", "rows.db", "--execute", "7"]].concat()).expect_code(0);
    let _ = run(dir.path(), &[&other[..], &["--db", "seed.db", "--seed", "3"]].concat()).expect_code(0);
    let pair = ["--a", "more", "--b", "idle", "--json"];
    let compare =
        |files: &[&'static str], extra: &[&'static str]| [&["compare"], files, &pair[..], extra].concat();
    let compared = json(&run(dir.path(), &compare(&["r.db", "same.db"], &[])).expect_code(0));
    assert_eq!(compared["cells"][0]["n"], 2);
    assert_eq!(compared["cells"][0]["n_unmatched"], 2);
    refuses(
        dir.path(),
        &compare(&["r.db", "late.db"], &[]),
        &["latency is 0", "100 in the second", "--across latency"],
    );
    let _ = run(dir.path(), &compare(&["r.db", "late.db"], &["--across", "latency"])).expect_code(0);
    // Rows per query belong to a policy: under one name they are two policies.
    let _ = run(dir.path(), &compare(&["r.db", "rows.db"], &[])).expect_code(0);
    refuses(
        dir.path(),
        &["compare", "same.db", "rows.db", "--a", "more", "--b", "idle"],
        &["no policy `more`", "same.db:more, rows.db:more"],
    );
    let apart = ["compare", "same.db", "rows.db", "--a", "same.db:more", "--b", "rows.db:more", "--json"];
    assert_eq!(json(&run(dir.path(), &apart).expect_code(0))["cells"][0]["n"], 2);
    // Nor is one policy the same under other options.
    let apart = ["compare", "same.db", "late.db", "--across", "latency", "--a", "same.db:more"];
    let apart = run(dir.path(), &[&apart[..], &["--b", "late.db:more"]].concat()).expect_code(0);
    assert!(apart.stdout.starts_with("latency: 0 in same.db, 100 in late.db\n"), "{}", apart.stdout);
    refuses(
        dir.path(),
        &compare(&["r.db", "seed.db"], &[]),
        &["seed is 0", "3 in the second", "--across seed"],
    );
    refuses(
        dir.path(),
        &compare(&["r.db"], &["--across", "version"]),
        &["--across version", "expected one of"],
    );
}

#[test]
fn seeds_are_pooled_on_request() {
    let dir = tempfile::tempdir().unwrap();
    let evaluate = |policies: &[&str], seed: &str, db: &str| {
        let more = ["--tasks", "RaiseCube", "--episodes", "3", "--seed", seed, "--db", db];
        let _ = run(dir.path(), &[&["run"], policies, &more].concat()).expect_code(0);
    };
    evaluate(&["--policy", "expert", "--policy", "idle"], "0", "a.db");
    evaluate(&["--policy", "expert"], "1", "b.db");
    evaluate(&["--policy", "idle"], "1", "c.db");
    let pooled =
        ["compare", "a.db", "b.db", "c.db", "--across", "seed", "--a", "expert", "--b", "idle", "--json"];
    let pooled = json(&run(dir.path(), &pooled).expect_code(0));
    assert_eq!((&pooled["cells"][0]["n"], &pooled["cells"][0]["successes"][0]), (&6.into(), &6.into()));
    assert_eq!(pooled["cells"][0]["n_unmatched"], 0);
    assert_eq!(pooled["groups"][0]["n"], 6);
}

#[test]
fn copies_of_a_row_must_agree() {
    let dir = tempfile::tempdir().unwrap();
    evaluate(dir.path(), &[]);
    let copy = |name: &str, statement: &str| {
        std::fs::copy(dir.path().join("r.db"), dir.path().join(name)).unwrap();
        sql(&dir.path().join(name), statement);
    };
    let pair = ["--a", "expert", "--b", "idle"];
    copy("same.db", "UPDATE episodes SET physics_s = 9");
    let _ = run(dir.path(), &[&["compare", "r.db", "same.db"], &pair[..]].concat()).expect_code(0);
    copy("better.db", "UPDATE episodes SET success_once = 1 WHERE policy = 'idle' AND episode = 2");
    refuses(
        dir.path(),
        &[&["compare", "r.db", "better.db"], &pair[..]].concat(),
        &["idle's", "episode 2 differs", "better.db in success_once"],
    );
    // Unless they are of another policy, such as a foreign host that has changed.
    let across = ["compare", "r.db", "better.db", "--across", "policy", "--a", "better.db:idle", "--json"];
    let across = json(&run(dir.path(), &[&across[..], &["--b", "r.db:idle"]].concat()).expect_code(0));
    assert_eq!((&across["n_flips"], &across["flips"][0]["episode"]), (&4.into(), &2.into()));
    // Another simulator makes other results.
    copy("code.db", "UPDATE manifest SET value = '\"0123\"' WHERE key = 'code'");
    let files = [&["compare", "r.db", "code.db"], &pair[..]].concat();
    refuses(dir.path(), &files, &["code is", "0123", "--across code"]);
    let resumed = ["run", "--policy", "idle", "--tasks", "RaiseCube", "--episodes", "4", "--db", "code.db"];
    refuses(dir.path(), &resumed, &["code is \"0123\" in the file"]);
    let across =
        ["compare", "r.db", "code.db", "--across", "code", "--a", "r.db:idle", "--b", "code.db:idle"];
    let _ = run(dir.path(), &across).expect_code(0);
}

#[test]
fn few_episodes_decide_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let args = ["run", "--policy", "expert", "--policy", "idle", "--policy", "random", "--tasks"];
    let more = ["RaiseCube,OpenDrawer,StackCube", "--episodes", "1", "--db", "r.db"];
    let _ = run(dir.path(), &[&args[..], &more].concat()).expect_code(0);
    for pair in [["expert", "idle"], ["idle", "random"]] {
        let args = ["compare", "r.db", "--a", pair[0], "--b", pair[1], "--json"];
        let compared = json(&run(dir.path(), &args).expect_code(0));
        for row in
            [&compared["groups"], &compared["cells"]].into_iter().flat_map(|rows| rows.as_array().unwrap())
        {
            assert_eq!(row["verdict"]["decision"], "undecided", "{row}");
        }
    }
    let compared =
        run(dir.path(), &["compare", "r.db", "--a", "expert", "--b", "idle"]).expect_code(0).stdout;
    assert!(compared.contains("Looking again after adding them"), "{compared}");
    // From these episodes a comparison can be planned.
    let plan = |extra: &[&str]| run(dir.path(), &[&["plan"], extra].concat());
    let planned = plan(&["r.db", "--a", "expert", "--b", "idle", "--json"]).expect_code(0);
    let planned = json(&planned);
    assert_eq!((&planned["from"]["cells"], &planned["rows"][2]["difference"]), (&3.into(), &0.1.into()));
    assert!(planned["from"]["episodes_per_s"].as_f64().unwrap() > 0.0, "{planned}");
    let given = json(&plan(&["--discordance", "0.3", "--difference", "0.1", "--json"]).expect_code(0));
    assert_eq!(given["rows"][1]["one_cell"]["per_cell"], 244);
    let many = ["--discordance", "0.3", "--difference", "0.1", "--cells", "28"];
    let many = plan(&many).expect_code(0).stdout;
    assert!(many.contains("each of 28 cells"), "{many}");
    refuses(
        dir.path(),
        &["plan", "--discordance", "0.1", "--difference", "0.2"],
        &["--difference is 0.2", "0.1000"],
    );
}

#[test]
fn unusable_results_give_one_clear_error() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path();
    evaluate(path, &[]);
    std::fs::write(path.join("text.db"), "not a database, but long enough to be one").unwrap();
    std::fs::copy(path.join("r.db"), path.join("old.db")).unwrap();
    sql(&path.join("old.db"), "PRAGMA user_version = 1");
    std::fs::copy(path.join("r.db"), path.join("empty.db")).unwrap();
    sql(&path.join("empty.db"), "DELETE FROM episodes");
    std::fs::copy(path.join("r.db"), path.join("apart.db")).unwrap();
    sql(&path.join("apart.db"), "DELETE FROM episodes WHERE (policy = 'idle') = (task = 'RaiseCube')");
    std::fs::write(path.join("hardware.csv"), "task,percent\nRaiseCube,10\n").unwrap();
    let pair = ["--a", "expert", "--b", "idle"];
    let compare = |file: &'static str| [&["compare", file], &pair[..]].concat();
    refuses(path, &compare("absent.db"), &["absent.db"]);
    refuses(path, &compare("text.db"), &["text.db", "another kind of file"]);
    refuses(path, &compare("old.db"), &["old.db", "version 1"]);
    refuses(path, &compare("empty.db"), &["empty.db", "has no episodes"]);
    refuses(path, &compare("apart.db"), &["expert and idle have no episode in common"]);
    refuses(path, &["compare", "r.db", "--a", "expert", "--b", "act"], &["no policy `act`", "expert, idle"]);
    refuses(path, &["compare", "r.db", "--a", "idle", "--b", "idle"], &["cannot be compared with itself"]);
    let report = ["report", "r.db", "-o", "out", "--hardware", "hardware.csv"];
    refuses(path, &report, &["hardware.csv", "task,percent", "success_percent"]);
    assert!(!path.join("out").exists(), "nothing is written");
}

#[test]
fn verify_finds_every_changed_column() {
    let dir = tempfile::tempdir().unwrap();
    let db = dir.path().join("r.db");
    let act = format!("act=act:{}", act_tiny());
    evaluate(dir.path(), &["--policy", &act, "--envs", "3"]);
    let verify = ["verify", "r.db", "--json", "--quiet", "--threads", "1", "--envs", "7"];
    let verified = json(&run(dir.path(), &verify).expect_code(0));
    assert_eq!((&verified["run"], &verified["agree"]), (&48.into(), &48.into()));
    sql(
        &db,
        "UPDATE episodes SET fingerprint = '0' || substr(fingerprint, 2, 14) || 'f'
            WHERE policy = 'act' AND task = 'RaiseCube' AND perturbation = 'None' AND episode = 2;
         UPDATE episodes SET success_once = 1
            WHERE policy = 'idle' AND task = 'OpenDrawer' AND perturbation = 'None' AND episode = 1;",
    );
    let verified = json(&run(dir.path(), &verify).expect_code(1));
    let found: Vec<String> = verified["differences"]
        .as_array()
        .unwrap()
        .iter()
        .map(|it| {
            format!("{} {} {}", it["policy"].as_str().unwrap(), it["episode"], it["column"].as_str().unwrap())
        })
        .collect();
    assert_eq!(found, ["act 2 fingerprint", "idle 1 success_once"]);
    assert_eq!(verified["agree"], 46);
    // A checkpoint that is not there any more is a reason, not an error.
    sql(&db, "UPDATE manifest SET value = json_set(value, '$.spec', 'act:gone') WHERE key = 'policy/act'");
    let verified = json(&run(dir.path(), &["verify", "r.db", "--json", "--quiet"]).expect_code(1));
    assert_eq!((&verified["run"], &verified["not_verified"][0]["n"]), (&32.into(), &16.into()));
    assert!(verified["not_verified"][0]["reason"].as_str().unwrap().contains("--checkpoint act=PATH"));
    refuses(dir.path(), &["verify", "r.db", "--checkpoint", "atc=x"], &["`atc`", "act, expert, idle"]);
}

/// A package is verified without its checkpoint elsewhere, and only with that of its results.
#[test]
fn package_is_verified_with_one_command() {
    let dir = tempfile::tempdir().unwrap();
    let weights = dir.path().join("weights");
    std::os::unix::fs::symlink(act_tiny(), &weights).unwrap();
    let args = ["run", "--policy", "act=act:weights", "--policy", "idle", "--tasks", "RaiseCube"];
    let _ = run(dir.path(), &[&args[..], &["--episodes", "3", "--db", "r.db"]].concat()).expect_code(0);
    let _ = run(dir.path(), &["pack", "r.db", "-o", "r.zip"]).expect_code(0);
    refuses(dir.path(), &["pack", "r.db", "-o", "r.zip"], &["r.zip exists"]);
    let elsewhere = tempfile::tempdir().unwrap();
    std::fs::copy(dir.path().join("r.zip"), elsewhere.path().join("r.zip")).unwrap();
    let verified = run(elsewhere.path(), &["verify", "r.zip", "--quiet", "--sample", "4"]).expect_code(0);
    let message = verified.stderr;
    assert!(message.contains("4 of 4 episodes agree in every column; with 95 % confidence"), "{message}");
    assert!(message.contains("at least 47.3 % of all 6"), "{message}");
    std::fs::remove_file(&weights).unwrap();
    refuses(dir.path(), &["pack", "r.db", "-o", "s.zip"], &["checkpoint of `act`", "--without-checkpoints"]);
    assert!(!dir.path().join("s.partial").exists());
    let bare = ["pack", "r.db", "-o", "s.zip", "--without-checkpoints"];
    let _ = run(dir.path(), &bare).expect_code(0);
    let verified = json(&run(elsewhere.path(), &["verify", "r.zip", "--json", "--quiet"]).expect_code(0));
    assert_eq!(verified["agree"], 6);
    let bare = dir.path().join("s.zip");
    let verified = ["verify", bare.to_str().unwrap(), "--json", "--quiet"];
    let verified = json(&run(elsewhere.path(), &verified).expect_code(1));
    assert_eq!((&verified["agree"], &verified["not_verified"][0]["n"]), (&3.into(), &3.into()));
    // An archive that is cut off.
    let packed = std::fs::read(dir.path().join("r.zip")).unwrap();
    std::fs::write(dir.path().join("cut.zip"), &packed[..packed.len() / 2]).unwrap();
    refuses(dir.path(), &["verify", "cut.zip"], &["failed to unpack cut.zip"]);
}

/// Equal results have equal packages without times, however they were made, and every analysis reads these.
#[test]
fn package_without_times_is_reproducible() {
    let dir = tempfile::tempdir().unwrap();
    let sweep = ["run", "--policy", "expert", "--policy", "idle", "--tasks", "RaiseCube", "--db"];
    let run_sweep = |rest: &[&str]| run(dir.path(), &[&sweep[..], rest].concat()).expect_code(0);
    let _ = run_sweep(&["a.db", "--episodes", "4", "--threads", "1"]);
    let _ = run_sweep(&["b.db", "--episodes", "2", "--envs", "3"]);
    let _ = run_sweep(&["b.db", "--episodes", "4", "--envs", "3"]);
    let pack = |db: &str, zip: &str| {
        let _ = run(dir.path(), &["pack", db, "-o", zip, "--without-times"]).expect_code(0);
        std::fs::read(dir.path().join(zip)).unwrap()
    };
    let packed = pack("a.db", "a.zip");
    assert!(packed == pack("b.db", "b.zip"), "packages differ");
    let verified = json(&run(dir.path(), &["verify", "b.zip", "--json", "--quiet"]).expect_code(0));
    assert_eq!((&verified["agree"], &verified["missing"]), (&8.into(), &Value::Array(Vec::new())));
    let compare = |file: &str| {
        run(dir.path(), &["compare", file, "--a", "idle", "--b", "expert"]).expect_code(0).stdout
    };
    assert_eq!(compare("a.zip").replace("a.zip", "a.db"), compare("a.db"));
    let _ = run(dir.path(), &["report", "a.zip", "-o", "report"]).expect_code(0);
    let costs = [&sweep[..], &["c.db", "--shard", "0/2", "--costs", "a.zip"]].concat();
    refuses(dir.path(), &costs, &["a.zip has no times", "--costs"]);
    // Other results have another package.
    sql(&dir.path().join("a.db"), "DELETE FROM episodes WHERE policy = 'idle' AND episode = 3");
    assert!(packed != pack("a.db", "c.zip"), "packages agree");
}

/// A file from which failures were deleted is not complete.
#[test]
fn verify_finds_missing_rows() {
    let dir = tempfile::tempdir().unwrap();
    // The checkpoint lies beside the file, and its path is relative.
    let folder = dir.path().join("results");
    std::fs::create_dir(&folder).unwrap();
    std::os::unix::fs::symlink(act_tiny(), folder.join("weights")).unwrap();
    let args = ["run", "--policy", "act=act:weights", "--policy", "idle", "--tasks", "RaiseCube,OpenDrawer"];
    let _ = run(&folder, &[&args[..], &["--episodes", "3", "--db", "r.db"]].concat()).expect_code(0);
    let verify = ["verify", "results/r.db", "--json", "--quiet"];
    let verified = json(&run(dir.path(), &verify).expect_code(0));
    assert_eq!((&verified["agree"], &verified["missing"]), (&12.into(), &Value::Array(Vec::new())));
    sql(
        &folder.join("r.db"),
        "DELETE FROM episodes WHERE policy = 'idle' AND (task = 'OpenDrawer' OR episode = 1)",
    );
    let verified = json(&run(dir.path(), &verify).expect_code(1));
    let missing: Vec<String> = verified["missing"]
        .as_array()
        .unwrap()
        .iter()
        .map(|gap| format!("{} {} {} {}", gap["policy"], gap["condition"]["task"], gap["n"], gap["first"]))
        .collect();
    assert_eq!(missing, ["\"idle\" \"RaiseCube\" 1 1", "\"idle\" \"OpenDrawer\" 3 0"]);
    let text = run(dir.path(), &["verify", "results/r.db", "--quiet"]).expect_code(1).stdout;
    assert!(text.contains("missing: 1 planned episodes of idle, RaiseCube None, from index 1 on"), "{text}");
    // Without a plan nobody knows.
    sql(&folder.join("r.db"), "DELETE FROM manifest WHERE key = 'plans'");
    let text = run(dir.path(), &["verify", "results/r.db", "--quiet"]).expect_code(1).stdout;
    assert!(text.contains("does not say which episodes were planned"), "{text}");
}

#[test]
fn decided_cells_end_without_changing_a_row() {
    let dir = tempfile::tempdir().unwrap();
    let base = [
        "run",
        "--policy",
        "expert",
        "--policy",
        "idle",
        "--tasks",
        "RaiseCube,OpenDrawer",
        "--episodes",
        "40",
    ];
    let until = ["--until-decided", "expert,idle", "--json", "--quiet"];
    // With few envs, most jobs are assigned after the first decisions, however fast the machine is.
    let until = [&until[..], &["--margin", "0.1", "--envs", "8"]].concat();
    let stopped = run(dir.path(), &[&base[..], &until[..], &["--db", "s.db"]].concat()).expect_code(0);
    let _ = run(dir.path(), &[&base[..], &["--db", "f.db", "--envs", "5"]].concat()).expect_code(0);
    let (some, all) = (rows(&dir.path().join("s.db")), rows(&dir.path().join("f.db")));
    assert_eq!(all.len(), 160);
    assert!(some.len() < 140, "{} rows", some.len());
    assert!(some.iter().all(|row| all.contains(row)), "rows are those of a full sweep");
    for cell in json(&stopped)["stopping"]["cells"].as_array().unwrap() {
        assert_eq!(cell["verdict"]["decision"], "a_better", "{cell}");
    }
    let compared = run(dir.path(), &["compare", "s.db", "--a", "expert", "--b", "idle", "--json"]);
    let compared = json(&compared.expect_code(0));
    assert_eq!(
        (&compared["tests"], &compared["cells"][0]["verdict"]["decision"]),
        (&"sequential".into(), &"a_better".into())
    );
    // The rule belongs to the file, no interval contradicts its verdict, and nothing is averaged.
    assert_eq!(
        (&compared["levels"]["margin"], &compared["groups"]),
        (&0.1.into(), &Value::Array(Vec::new()))
    );
    assert!(compared["cells"][0]["interval"][0].as_f64().unwrap() >= 0.0);
    let pair = ["compare", "s.db", "--a", "expert", "--b", "idle"];
    refuses(dir.path(), &[&pair[..], &["--margin", "0.05"]].concat(), &["s.db", "--margin 0.1 --alpha 0.05"]);
    let _ = run(dir.path(), &["verify", "s.db", "--quiet", "--sample", "2"]).expect_code(0);
    let _ = run(dir.path(), &["report", "s.db", "-o", "out"]).expect_code(0);
    let page = std::fs::read_to_string(dir.path().join("out/index.html")).unwrap();
    assert!(!page.contains("figure-categories") && !page.contains("figure-time-to-success"));
}

/// Returns the bytes of the executed rows of every episode in a results file.
fn executed_actions(db: &Path) -> Vec<Vec<Vec<u8>>> {
    let connection = rusqlite::Connection::open(db).unwrap();
    let mut statement = connection.prepare("SELECT steps, actions FROM episodes").unwrap();
    let episodes = statement.query_map([], |row| Ok((row.get::<_, u32>(0)?, row.get::<_, Vec<u8>>(1)?)));
    let rows = |(steps, actions): (u32, Vec<u8>)| {
        actions.chunks_exact(actions.len() / steps as usize).map(<[u8]>::to_vec).collect()
    };
    episodes.unwrap().map(|episode| rows(episode.unwrap())).collect()
}

#[test]
fn late_rows_are_independent_of_envs_and_threads() {
    let with = |extra: &[&str]| {
        let dir = tempfile::tempdir().unwrap();
        let act = format!("act=act:{}", act_tiny());
        let mut args =
            vec!["run", "--policy", "random", "--policy", &act, "--tasks", "RaiseCube,DualArmLiftTray"];
        args.extend(["--episodes", "3", "--execute", "4", "--db", "r.db"]);
        args.extend(extra);
        let _ = run(dir.path(), &args).expect_code(0);
        rows(&dir.path().join("r.db"))
    };
    let late = with(&["--latency", "180", "--envs", "1"]);
    assert_eq!(late.len(), 12);
    assert_eq!(
        late,
        with(&["--latency", "151", "--envs", "5", "--threads", "1"]),
        "both are four control steps"
    );
    assert_ne!(late, with(&["--latency", "250", "--envs", "5"]));
    let immediate = with(&[]);
    let differs = late.iter().zip(&immediate).filter(|(late, immediate)| late[10] != immediate[10]).count();
    assert_eq!(differs, 12, "every trajectory depends on latency");
    let dir = tempfile::tempdir().unwrap();
    let act = format!("act=act:{}", act_tiny());
    let args = ["run", "--policy", &act, "--tasks", "RaiseCube", "--episodes", "2", "--execute", "4"];
    let _ = run(dir.path(), &[&args[..], &["--latency", "180", "--db", "r.db"]].concat()).expect_code(0);
    // The robot holds still until the first chunk takes effect. Later the chunk has more rows than four.
    for actions in executed_actions(&dir.path().join("r.db")) {
        assert!(actions[..4].windows(2).all(|rows| rows[0] == rows[1]));
        assert!(actions[4..].windows(2).all(|rows| rows[0] != rows[1]), "no row is held");
    }
    // Longer than the episode: the robot never hears an answer.
    let _ = with(&["--latency", "10000"]);
}
