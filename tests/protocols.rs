//! Evaluation protocols: what they change, what they leave alone, and that their results are never mixed.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::path::Path;

use serde_json::{Value, json};
use support::{Row, act_tiny, rows, run};

/// Copies LeRobot's ACT of the tests with image features of this size.
fn checkpoint(folder: &Path, [height, width]: [usize; 2]) -> String {
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("../policy-host/tests/data/lerobot/robot");
    let to = folder.join(format!("act-{width}x{height}"));
    fs::create_dir(&to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        fs::copy(&path, to.join(path.file_name().unwrap())).unwrap();
    }
    let config = to.join("config.json");
    let mut settings: Value = serde_json::from_slice(&fs::read(&config).unwrap()).unwrap();
    for (name, feature) in settings["input_features"].as_object_mut().unwrap() {
        if name.starts_with("observation.images.") {
            feature["shape"] = json!([3, height, width]);
        }
    }
    fs::write(config, settings.to_string()).unwrap();
    format!("act:{}", to.display())
}

fn evaluate(folder: &Path, policy: &str, db: &str, more: &[&str]) -> Vec<Row> {
    let args = ["run", "--policy", policy, "--tasks", "RaiseCube,DualArmDrawerOpen", "--episodes", "2"];
    run(folder, &[&args[..], &["--db", db], more].concat()).expect_code(0);
    rows(&folder.join(db))
}

#[test]
fn lerobot_protocol_ends_episodes_at_success() {
    let dir = tempfile::tempdir().unwrap();
    let act = evaluate(dir.path(), "expert", "act.db", &[]);
    let lerobot = evaluate(dir.path(), "expert", "lerobot.db", &["--protocol", "lerobot"]);
    let horizon =
        evaluate(dir.path(), "expert", "horizon.db", &["--protocol", "lerobot", "--end", "horizon"]);
    // Columns: 5 steps, 6 success_once, 7 success_at_end, 8 first_success_step.
    for (long, short) in act.iter().zip(&lerobot) {
        assert_eq!(long[..5], short[..5]);
        assert_eq!((&short[5], short[7].as_str()), (&short[8], "Integer(1)"), "{short:?}");
        assert_eq!((&long[6], &long[8]), (&short[6], &short[8]));
        assert_ne!(long[5], short[5]);
    }
    assert_eq!(act, horizon, "an expert sees neither images nor sentences");
    run(dir.path(), &["verify", "lerobot.db"]).expect_code(0);
    run(dir.path(), &["replay", "lerobot.db"]).expect_code(0);

    let resumed =
        ["run", "--policy", "expert", "--tasks", "RaiseCube", "--episodes", "3", "--db", "lerobot.db"];
    let refused = run(dir.path(), &resumed).expect_code(2).stderr;
    assert!(
        refused.contains("protocol is \"lerobot\" in the file, but \"act\" in this command"),
        "{refused}"
    );
    let apart = ["compare", "act.db", "lerobot.db", "--a", "act.db:expert", "--b", "lerobot.db:expert"];
    let refused = run(dir.path(), &apart).expect_code(2).stderr;
    assert!(refused.contains("protocol is \"act\" in the first and \"lerobot\" in the second"), "{refused}");
    let across = "end,image_size,instructions,protocol";
    assert!(refused.contains(&format!("--across {across}")), "{refused}");
    run(dir.path(), &[&apart[..], &["--across", across]].concat()).expect_code(0);
    let args = ["report", "lerobot.db", "-o", "page", "--format", "csv"];
    run(dir.path(), &args).expect_code(0);
    let page = fs::read_to_string(dir.path().join("page/index.html")).unwrap();
    assert!(page.contains("640x480") && page.contains("protocol"));
    let csv = fs::read_to_string(dir.path().join("page/expert.single_arm.csv")).unwrap();
    assert!(csv.contains(",none,RaiseCube-v1,") && csv.contains(",results_df,2,100.00"), "{csv}");
}

#[test]
fn perturbations_are_known_by_the_benchmarks_spelling() {
    let dir = tempfile::tempdir().unwrap();
    let args = ["run", "--policy", "idle", "--tasks", "RaiseCube", "--episodes", "1", "--db", "r.db"];
    let spelled = ["--perturbations", "NONE,MO_COLOR,DISTRACTOR_OBJECT,ALL"];
    run(dir.path(), &[&args[..], &spelled].concat()).expect_code(0);
    let connection = rusqlite::Connection::open(dir.path().join("r.db")).unwrap();
    let sql = "SELECT group_concat(perturbation, ' ') FROM (SELECT perturbation FROM episodes ORDER BY 1)";
    let names: String = connection.query_row(sql, [], |row| row.get(0)).unwrap();
    assert_eq!(names, "All Distractor-Objects MO-Color None");
}

#[test]
fn episodes_are_independent_of_batches_at_any_size() {
    let dir = tempfile::tempdir().unwrap();
    let policy = format!("act:{}", act_tiny());
    let size = ["--image-size", "99x65,wrist=70x64"];
    let one = ["--envs", "1", "--threads", "1"];
    let rows_of_one = evaluate(dir.path(), &policy, "one.db", &[&size[..], &one].concat());
    let many = ["--envs", "4", "--threads", "2", "--check-frames"];
    assert_eq!(evaluate(dir.path(), &policy, "many.db", &[&size[..], &many].concat()), rows_of_one);
    let usual = evaluate(dir.path(), &policy, "usual.db", &[]);
    assert!(
        usual.iter().zip(&rows_of_one).all(|(usual, small)| usual != small),
        "other images, other actions"
    );
    let explicit = ["--image-size", "224x224,wrist=128x128", "--instructions", "act", "--end", "horizon"];
    assert_eq!(evaluate(dir.path(), &policy, "explicit.db", &explicit), usual);
}

#[test]
fn checkpoint_gets_the_protocol_of_its_images() {
    let dir = tempfile::tempdir().unwrap();
    let [lerobot, small] = [[480, 640], [96, 96]].map(|size| checkpoint(dir.path(), size));
    let one = |policies: &[&str], more: &[&str]| {
        let policies: Vec<&str> = policies.iter().flat_map(|policy| ["--policy", policy]).collect();
        let args = ["--tasks", "RaiseCube", "--episodes", "1"];
        run(dir.path(), &[&["run"], &policies[..], &args, more].concat())
    };
    let ran = one(&[&lerobot], &["--db", "own.db"]).expect_code(0).stderr;
    assert!(ran.contains("protocol lerobot: 640x480 images, lerobot instructions"), "{ran}");
    assert!(!ran.contains("instead of"), "{ran}");
    let ran = one(&[&lerobot], &["--db", "act.db", "--protocol", "act"]).expect_code(0).stderr;
    let differs =
        "resizes images that differ from those of training: external1_camera 224x224 instead of 640x480";
    assert!(ran.contains(differs), "{ran}");
    let fps = ["fps", "--policy", &lerobot, "--mode", "chunk", "--envs", "1", "--seconds", "1", "-o", "fps"];
    run(dir.path(), &fps).expect_code(0);
    let measured = fs::read_to_string(dir.path().join("fps/fps.json")).unwrap();
    assert!(measured.contains("\"image_size\": \"640x480\""), "{measured}");
    let [a, b] = [format!("a={lerobot}"), format!("b={small}")];
    let refused = one(&[&a, &b], &["--db", "two.db"]).expect_code(2).stderr;
    assert!(refused.contains("`a` was trained for protocol lerobot, `b` for act"), "{refused}");
}

#[test]
fn demonstrations_have_the_features_of_their_protocol() {
    let dir = tempfile::tempdir().unwrap();
    let args = ["demos", "-o", "d", "--tasks", "RaiseCube,DualArmDrawerOpen", "--episodes", "1"];
    let args = [&args[..], &["--protocol", "lerobot", "--image-size", "96x64"]].concat();
    run(dir.path(), &args).expect_code(0);
    for (robot, width, wrist) in [("single", 9, "hand_camera"), ("bimanual", 18, "panda2_hand_camera")] {
        let info = fs::read(dir.path().join("d").join(robot).join("meta/info.json")).unwrap();
        let info: Value = serde_json::from_slice(&info).unwrap();
        let features = info["features"].as_object().unwrap();
        assert_eq!(features["observation.state"]["shape"], json!([width]));
        for camera in ["external1_camera", "external2_camera", wrist] {
            assert_eq!(features[&format!("observation.images.{camera}")]["shape"], json!([64, 96, 3]));
        }
        assert!(!features.contains_key("observation.environment_state"));
    }
    let journal = fs::read_to_string(dir.path().join("d/single/meta/hypogeum.jsonl")).unwrap();
    assert!(journal.contains("Raise the cube up from the table"), "{journal}");
    run(dir.path(), &["replay", "d/single"]).expect_code(0);
}

#[test]
fn unusable_protocol_options_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("sentences.yaml"), "StackCubeColosseumV2-v1: stack\n").unwrap();
    let refused = |args: &[&str], expected: &str| {
        let run_args = ["run", "--policy", "idle", "--tasks", "RaiseCube", "--episodes", "1", "--db", "r.db"];
        let stderr = run(dir.path(), &[&run_args[..], args].concat()).expect_code(2).stderr;
        assert!(stderr.contains(expected), "{stderr}");
    };
    refused(&["--image-size", "1281x480"], "expected 64x64 to 1280x960");
    refused(&["--image-size", "640x480,hand=64x64"], "expected wrist=WxH");
    refused(&["--instructions", "sentences.yaml"], "no sentences for `RaiseCube-v1`");
    refused(&["--instructions", "nowhere.yaml"], "failed to read nowhere.yaml");
    refused(&["--end", "never"], "invalid value 'never'");
    let demos = ["demos", "-o", "d", "--tasks", "RaiseCube", "--episodes", "1", "--end", "success"];
    assert!(run(dir.path(), &demos).expect_code(2).stderr.contains("--end"));
}
