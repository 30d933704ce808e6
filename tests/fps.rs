//! `hypogeum fps`: the measurement of speed over the number of environments.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::path::Path;

use serde_json::Value;
use support::{act_tiny, run};

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
fn other_settings_need_another_folder() {
    let dir = tempfile::tempdir().unwrap();
    let args = ["fps", "--policy", "idle", "--mode", "chunk", "--envs", "1", "--seconds", "1"];
    let _ = run(dir.path(), &args).expect_code(0);
    let refused = run(dir.path(), &[&args[..], &["--execute", "5"]].concat()).expect_code(2);
    for part in ["fps/points.jsonl", "options", "-o"] {
        assert!(refused.stderr.contains(part), "{}", refused.stderr);
    }
    let unloadable = ["fps", "--policy", "act:nowhere", "--envs", "1", "-o", "other"];
    assert!(run(dir.path(), &unloadable).expect_code(2).stderr.contains("nowhere"));
}
