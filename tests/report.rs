//! The page of `hypogeum report`, its data and exports.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;

use serde_json::Value;
use support::{act_tiny, run};

#[test]
fn report_is_complete_and_needs_no_network() {
    let dir = tempfile::tempdir().unwrap();
    let act = format!("act=act:{}", act_tiny());
    let policies = ["run", "--policy", "expert", "--policy", "idle", "--policy", &act, "--policy", "random"];
    let cells = ["--tasks", "RaiseCube,OpenDrawer", "--perturbations", "None,Light-Color", "--episodes", "4"];
    let _ = run(dir.path(), &[&policies[..], &cells, &["--db", "r.db"]].concat()).expect_code(0);
    std::fs::write(
        dir.path().join("hardware.csv"),
        "task,perturbation,success_percent\nRaiseCube,None,50\nOpenDrawer,None,80\n",
    )
    .unwrap();
    std::fs::write(dir.path().join("fps.csv"), "batch_size,frames_per_second\n1,20\n10,150\n").unwrap();
    let args = ["report", "r.db", "-o", "out", "--hardware", "hardware.csv", "--fps", "fps.csv"];
    let formats = ["--format", "csv,parquet,json,lerobot,vla-eval"];
    let report = run(dir.path(), &[&args[..], &formats[..]].concat()).expect_code(0);
    assert!(report.stderr.contains("fewer than 50 episodes"), "{}", report.stderr);
    let out = dir.path().join("out");
    let page = std::fs::read_to_string(out.join("index.html")).unwrap();
    for id in [
        "waterfall-single-arm",
        "categories",
        "time-to-success",
        "failed-predicates",
        "time",
        "hardware",
        "fps",
        "forest-0",
    ] {
        assert!(page.contains(&format!("id=\"figure-{id}\"")), "the page should have the figure {id}");
    }
    for outside in ["src=\"http", "href=\"http", "url(http", "@import"] {
        assert!(!page.contains(outside), "the page should not use {outside}");
    }
    assert_eq!(page.lines().find(|line| line.contains("\"NaN") || line.contains(">NaN")), None);
    let data: Value = serde_json::from_slice(&std::fs::read(out.join("data.json")).unwrap()).unwrap();
    assert_eq!(data["cells"].as_array().unwrap().len(), 16);
    let lerobot: Value =
        serde_json::from_slice(&std::fs::read(out.join("expert.eval_info.json")).unwrap()).unwrap();
    assert_eq!(
        (&lerobot["overall"]["pc_success"], &lerobot["overall"]["n_episodes"]),
        (&100.0.into(), &16.into())
    );
    let vla: Value = serde_json::from_slice(&std::fs::read(out.join("idle.vla-eval.json")).unwrap()).unwrap();
    assert_eq!((&vla["mean_success"], &vla["tasks"][0]["num_episodes"]), (&0.0.into(), &4.into()));
    let csv = std::fs::read_to_string(out.join("expert.single_arm.csv")).unwrap();
    assert!(csv.lines().count() == 5, "{csv}");
    assert!(csv.contains(",none,RaiseCube-v1,pd_joint_pos,False,4,92,,4,100.00\n"), "{csv}");
    for table in ["episodes.parquet", "cells.parquet"] {
        assert!(out.join(table).metadata().unwrap().len() > 1000, "{table}");
    }
}

/// Replaces the only episode of a results file by copies: 200 per cell, with the cell's success rate in %.
fn replace_episodes(path: &Path, columns: [&str; 7], table: &[(&str, [f64; 7])]) {
    let mut connection = rusqlite::Connection::open(path).unwrap();
    let transaction = connection.transaction().unwrap();
    transaction
        .execute_batch("CREATE TEMP TABLE one AS SELECT * FROM episodes; DELETE FROM episodes")
        .unwrap();
    for (task, rates) in table {
        for (perturbation, rate) in columns.iter().zip(rates).filter(|(_, rate)| rate.is_finite()) {
            for episode in 0..200 {
                let success = f64::from(episode) < 2.0 * rate;
                transaction
                    .execute(
                        "UPDATE one SET task = ?1, perturbation = ?2, episode = ?3, success_once = ?4",
                        (task, perturbation, episode, success),
                    )
                    .unwrap();
                transaction.execute("INSERT INTO episodes SELECT * FROM one", []).unwrap();
            }
        }
    }
    transaction.execute("DELETE FROM manifest WHERE key = 'plans'", []).unwrap();
    transaction.commit().unwrap();
    drop(connection);
    orchestrator::fuzzing::seal_results(path);
}

/// Success rates in percent of an earlier ACT over 200 episodes (`scripts/colosseum_v2_paper` of the
/// original at commit b603b58), and the changes that its code computes from them.
#[test]
fn golden_table_gives_the_paper_s_changes() {
    let dir = tempfile::tempdir().unwrap();
    let columns = ["None", "All", "MO-Color", "RO-Color", "Camera-Pose", "Language-Paraphrase", "MO-Size"];
    let table: [(&str, [f64; 7]); 12] = [
        ("DualArmLiftPot", [97.5, 0.0, 61.5, f64::NAN, 49.0, 94.0, 42.0]),
        ("DualArmPushBox", [82.0, 1.5, 42.0, f64::NAN, 72.5, 76.5, 75.5]),
        ("DualArmLiftTray", [70.5, 0.0, 23.5, f64::NAN, 41.5, 66.5, 8.0]),
        ("DualArmPourPot", [68.0, 2.5, 71.0, 66.5, 72.5, 63.5, 36.5]),
        ("DualArmStackCube", [59.5, 0.0, 0.0, 23.5, 5.0, 56.0, 39.5]),
        ("DualArmPenCap", [18.0, 2.0, 7.0, 5.0, 8.0, 15.5, f64::NAN]),
        // Below 10 %: they count for no change.
        ("DualArmThreading", [9.0, 0.0, 3.5, 2.5, 0.5, 8.5, f64::NAN]),
        ("DualArmDrawerOpen", [6.0, 5.5, f64::NAN, f64::NAN, 5.5, 10.0, f64::NAN]),
        ("DualArmStackTwoCubes", [3.5, 0.0, 0.0, 7.0, 0.0, 5.0, 2.5]),
        ("DualArmBottleHandover", [1.0, 4.5, 2.5, f64::NAN, 1.0, 0.0, 0.5]),
        ("DualArmCubeHandover", [0.0, 0.0, 0.0, f64::NAN, 0.5, 0.0, 0.0]),
        ("DualArmDrawerPlace", [0.0, 0.0, 0.0, f64::NAN, 0.0, 0.0, 0.0]),
    ];
    let act = format!("act=act:{}", act_tiny());
    let args = ["run", "--policy", &act, "--tasks", "RaiseCube", "--episodes", "1", "--db", "r.db"];
    let _ = run(dir.path(), &args).expect_code(0);
    replace_episodes(&dir.path().join("r.db"), columns, &table);
    let _ = run(dir.path(), &["report", "r.db", "-o", "out"]).expect_code(0);
    let data: Value =
        serde_json::from_slice(&std::fs::read(dir.path().join("out/data.json")).unwrap()).unwrap();
    let percent = |value: &Value| (1e5 * value.as_f64().unwrap()).round() / 1e3;
    let found: Vec<(&str, f64, f64)> = data["effects"]
        .as_array()
        .unwrap()
        .iter()
        .map(|it| {
            (it["perturbation"].as_str().unwrap(), percent(&it["change"]), percent(&it["relative_change"]))
        })
        .map(|(name, change, relative)| (name, change, (10.0 * relative).round() / 10.0))
        .collect();
    let near = |name: &str| found.iter().find(|row| row.0 == name).copied().unwrap();
    assert_eq!(near("MO-Color").1, -31.75);
    assert_eq!(near("RO-Color").1, -16.833);
    assert_eq!((near("Camera-Pose").1, near("Language-Paraphrase").1), (-24.5, -3.917));
    assert_eq!((near("MO-Size").1, near("All").1), (-35.2, -64.917));
    assert!((near("All").2 + 97.23).abs() < 0.06, "{found:?}");
    // The comparison with the policy's own twins averages in the same way.
    let page = std::fs::read_to_string(dir.path().join("out/index.html")).unwrap();
    assert!(page.contains("id=\"figure-changes-bimanual\""));
    let groups = data["perturbations"][0]["groups"].as_array().unwrap();
    let group = |name: &str| percent(&groups.iter().find(|group| group["group"] == name).unwrap()["mean"]);
    assert_eq!(group("MO-Color, bimanual"), -31.75);
    assert_eq!(group("vision, bimanual"), percent(&data["modality_effects"][0]["change"]));
    // All tasks of two arms are there, so the means stand beside those that the paper gives of its ACT.
    let published: Vec<(&str, f64, f64)> = data["published"]
        .as_array()
        .unwrap()
        .iter()
        .map(|row| (row["quantity"].as_str().unwrap(), &row["ours"], row["paper"].as_f64().unwrap()))
        .map(|(quantity, ours, paper)| (quantity, (1e3 * ours.as_f64().unwrap()).round() / 1e3, paper))
        .collect();
    assert!(published.contains(&("unperturbed success", 34.583, 44.5)), "{published:?}");
    assert!(published.contains(&("change under Language-Paraphrase", -3.917, -0.57)), "{published:?}");
    assert!(page.contains("Beside the paper's values"));
}
