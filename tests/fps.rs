//! Measurement of speed: `hypogeum fps`, and the ledger and the trace of `run`.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::path::Path;

use serde_json::Value;
use support::{act_tiny, rows, run};

/// Measures act in both modes with 1 and 3 envs.
fn measure(dir: &Path, extra: &[&str]) -> Value {
    let act = format!("act=act:{}", act_tiny());
    let mut args =
        vec!["fps", "--policy", &act, "--policy", "idle", "--envs", "3,1", "--seconds", "1", "--json"];
    args.extend(extra);
    serde_json::from_str(&run(dir, &args).expect_code(0).stdout).unwrap()
}

#[test]
fn points_account_for_all_cores_and_resume() {
    let dir = tempfile::tempdir().unwrap();
    let measured = measure(dir.path(), &[]);
    let points = measured["points"].as_array().unwrap();
    assert_eq!(points.len(), 8);
    let n_cores = measured["settings"]["machine"]["n_cores"].as_f64().unwrap();
    for point in points {
        let number = |key: &str| point[key].as_f64().unwrap_or_else(|| panic!("{key} of {point:#}"));
        let parts = point["core_s_per_step"].as_object().unwrap();
        let sum: f64 = parts.values().map(|part| part.as_f64().unwrap()).sum();
        let all = n_cores / number("env_steps_per_s");
        // Of a fleet that is stopped, the last unanswered query is estimated.
        assert!((sum / all - 1.0).abs() < 0.25, "{point:#}");
        assert!(number("wall_s") >= 1.0 && number("env_steps") >= 2.0 * number("envs"), "{point:#}");
        assert!(number("paper_fps") < number("env_steps_per_s"), "{point:#}");
        assert!(number("latency_p50_s") <= number("latency_p95_s"), "{point:#}");
        assert!(number("memory_bytes") > 1e6 && number("shm_bytes") > 1e4, "{point:#}");
        let is_act = point["policy"] == "act";
        assert_eq!(number("images_per_s") > 0.0, is_act, "{point:#}");
    }
    // Nothing is measured again.
    assert_eq!(measure(dir.path(), &[])["points"], measured["points"]);
    // The report reads the original's columns.
    let csv = fs::read_to_string(dir.path().join("fps/act-ensemble.csv")).unwrap();
    assert!(csv.starts_with("batch_size,t_elapsed_sec,frames_per_second,"), "{csv}");
    assert_eq!(csv.lines().count(), 3);
    let episodes = ["run", "--policy", "idle", "--tasks", "RaiseCube", "--episodes", "1", "--db", "r.db"];
    let _ = run(dir.path(), &episodes).expect_code(0);
    let report = ["report", "r.db", "-o", "report", "--fps", "fps/act-ensemble.csv"];
    let _ = run(dir.path(), &report).expect_code(0);
    let svg = fs::read_to_string(dir.path().join("fps/fps.svg")).unwrap();
    assert!(svg.contains("act-chunk") && svg.contains("idle-ensemble"), "{svg}");
}

#[test]
fn chosen_envs_and_rounds_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    let measure = |rounds: &str| -> Value {
        let args = ["fps", "--policy", "idle", "--mode", "chunk", "--seconds", "1", "--json"];
        let more = ["--tasks", "RaiseCube,DualArmLiftPot", "--envs", "auto,2", "--rounds", rounds];
        serde_json::from_str(&run(dir.path(), &[&args[..], &more[..]].concat()).expect_code(0).stdout)
            .unwrap()
    };
    let once = measure("1");
    let more = measure("3");
    assert_eq!(more["settings"]["tasks"], serde_json::json!(["RaiseCube", "DualArmLiftPot"]));
    for (idx, envs) in [Value::from(2), Value::from("auto")].iter().enumerate() {
        let (point, first) = (&more["points"][idx], &once["points"][idx]);
        assert_eq!(point["envs"], *envs);
        let rates = point["rounds_env_steps_per_s"].as_array().unwrap();
        assert_eq!((rates.len(), &rates[1]), (3, &point["env_steps_per_s"]), "{point:#}");
        assert!(rates.contains(&first["env_steps_per_s"]), "the first round was measured again: {point:#}");
    }
    let n_envs = more["points"][1]["n_envs"].as_u64().unwrap();
    let svg = fs::read_to_string(dir.path().join("fps/fps.svg")).unwrap();
    assert!(n_envs > 0 && svg.contains(&format!("auto ({n_envs})")), "{svg}");
    let csv = fs::read_to_string(dir.path().join("fps/idle-chunk.csv")).unwrap();
    assert!(csv.lines().last().unwrap().ends_with(",auto"), "{csv}");
}

#[test]
fn other_settings_need_another_folder() {
    let dir = tempfile::tempdir().unwrap();
    let args = ["fps", "--policy", "idle", "--mode", "chunk", "--envs", "1", "--seconds", "1"];
    let _ = run(dir.path(), &args).expect_code(0);
    let refused = run(dir.path(), &[&args[..], &["--execute", "5"]].concat()).expect_code(2);
    for part in ["fps/points.jsonl", "options", "-o"] {
        assert!(refused.stderr.contains(part), "{}", refused.stderr);
    }
    // The settings of an earlier version, which measured one task.
    let file = dir.path().join("fps/points.jsonl");
    let earlier =
        fs::read_to_string(&file).unwrap().replace("\"tasks\":[\"RaiseCube\"]", "\"task\":\"RaiseCube\"");
    fs::write(&file, earlier).unwrap();
    let refused = run(dir.path(), &args).expect_code(2);
    for part in ["fps/points.jsonl, line 1", "tasks", "-o"] {
        assert!(refused.stderr.contains(part), "{}", refused.stderr);
    }
    let unloadable = ["fps", "--policy", "act:nowhere", "--envs", "1", "-o", "other"];
    assert!(run(dir.path(), &unloadable).expect_code(2).stderr.contains("nowhere"));
}

/// Runs act in five episodes of RaiseCube with further arguments. Returns the report.
fn evaluate(dir: &Path, db: &str, extra: &[&str]) -> Value {
    let act = format!("act=act:{}", act_tiny());
    let mut args = vec!["run", "--policy", &act, "--tasks", "RaiseCube", "--episodes", "5", "--json"];
    args.extend(["--db", db]);
    args.extend(extra);
    serde_json::from_str(&run(dir, &args).expect_code(0).stdout).unwrap()
}

#[test]
fn ledger_adds_up_to_all_cores() {
    let dir = tempfile::tempdir().unwrap();
    let report = evaluate(dir.path(), "r.db", &[]);
    let n_cores = report["run"]["environment"]["machine"]["n_cores"].as_f64().unwrap();
    let part = |name: &str| report["ledger"][name].as_f64().unwrap();
    let parts = ["physics_s", "render_s", "policy_s", "transport_s", "unused_s"];
    let sum: f64 = parts.into_iter().map(part).sum();
    let all = n_cores * report["fps"]["wall_s"].as_f64().unwrap();
    assert!((sum / all - 1.0).abs() < 0.03, "{sum} of {all} core-seconds: {:#}", report["ledger"]);
    assert!(parts[..3].iter().all(|name| part(name) > 0.0), "{:#}", report["ledger"]);
    let inference = &report["fps"]["inference"];
    let number = |key: &str| inference[key].as_f64().unwrap_or_else(|| panic!("{key} of {inference}"));
    let fraction = number("gflop_per_core_s") / number("peak_gflop_per_core_s");
    assert!(fraction > 0.0 && (fraction - number("fraction")).abs() < 1e-9, "{inference}");
    // The episodes are too few to choose a number of envs from.
    assert_eq!(report["run"]["environment"]["env_choice"]["envs"], 5);
}

#[test]
fn trace_shows_all_processes_and_changes_no_row() {
    let dir = tempfile::tempdir().unwrap();
    let report = evaluate(dir.path(), "traced.db", &["--trace", "trace.json"]);
    let trace = fs::read_to_string(dir.path().join("trace.json")).unwrap();
    let events: Vec<Value> = serde_json::from_str(&trace).unwrap();
    let of = |name: &str| events.iter().filter(|event| event["name"] == name).collect::<Vec<_>>();
    let processes: Vec<_> = of("process_name").iter().map(|event| event["args"]["name"].clone()).collect();
    for process in ["sim", "host of `act`", "orchestrator"] {
        assert!(processes.iter().any(|name| name == process), "{process} in {processes:?}");
    }
    let n = |name: &str| of(name).iter().map(|event| event["args"]["n"].as_u64().unwrap()).sum::<u64>();
    assert_eq!(n("step"), report["fps"]["env_steps"].as_u64().unwrap());
    assert_eq!((n("build"), n("store")), (5, 5));
    // Each batch is observed, in flight (with a start and an end) and inferred.
    assert_eq!((n("observe"), n("in_flight")), (n("infer"), 2 * n("infer")));
    assert_eq!(n("render"), 3 * n("infer"), "one image per camera");
    assert!(of("infer").iter().all(|event| event["dur"].as_f64().unwrap() > 0.0));
    let _ = evaluate(dir.path(), "plain.db", &["--envs", "2"]);
    assert_eq!(rows(&dir.path().join("traced.db")), rows(&dir.path().join("plain.db")));
    let act = format!("act=act:{}", act_tiny());
    let args = ["run", "--policy", &act, "--tasks", "RaiseCube", "--trace", "nowhere/trace.json"];
    let refused = run(dir.path(), &args).expect_code(2);
    assert!(refused.stderr.contains("nowhere/trace.json"), "{}", refused.stderr);
}
