//! User errors: each produces one clear message and exit code 2, and loses no data.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs::{self, File};
use std::io::BufReader;
use std::path::Path;
use std::time::{Duration, Instant};

use support::{act_tiny, finish, hypogeum, rows, run};

/// Runs the program and asserts exit code 2 and exactly one error, which contains all of `words`.
#[track_caller]
fn assert_rejected(dir: &Path, args: &[&str], words: &[&str]) {
    let finished = run(dir, args).expect_code(2);
    let errors: Vec<&str> = finished.stderr.lines().filter(|line| line.starts_with("error")).collect();
    assert_eq!(errors.len(), 1, "one error: {}", finished.stderr);
    for word in words {
        assert!(finished.stderr.contains(word), "`{word}` is missing in: {}", finished.stderr);
    }
    assert!(!finished.stderr.contains("panicked"), "{}", finished.stderr);
}

#[test]
fn unknown_name_suggests_the_closest_one() {
    let dir = tempfile::tempdir().unwrap();
    assert_rejected(
        dir.path(),
        &["run", "--policy", "idle", "--tasks", "RaiseCub"],
        &["RaiseCub", "RaiseCube"],
    );
    let args = ["run", "--policy", "idle", "--tasks", "RaiseCube", "--perturbations", "MO-Colour"];
    assert_rejected(dir.path(), &args, &["MO-Colour", "MO-Color"]);
    assert_rejected(dir.path(), &["run", "--policy", "idel", "--tasks", "RaiseCube"], &["idel", "idle"]);
}

#[test]
fn sweep_file_with_unknown_key_is_rejected() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("sweep.toml"), "tasks = [\"RaiseCube\"]\nepisode = 3\n").unwrap();
    assert_rejected(dir.path(), &["run", "sweep.toml"], &["sweep.toml", "episode"]);
    assert_rejected(dir.path(), &["run", "absent.toml"], &["absent.toml"]);
}

/// Copies the tiny checkpoint to `dir/act`.
fn copy_checkpoint(dir: &Path) {
    for morphology in ["single", "bimanual"] {
        let (from, to) = (Path::new(&act_tiny()).join(morphology), dir.join("act").join(morphology));
        fs::create_dir_all(&to).unwrap();
        for file in fs::read_dir(from).unwrap() {
            let file = file.unwrap();
            fs::copy(file.path(), to.join(file.file_name())).unwrap();
        }
    }
}

#[test]
fn bad_checkpoint_is_rejected_before_the_run_starts() {
    let dir = tempfile::tempdir().unwrap();
    copy_checkpoint(dir.path());
    let args = ["run", "--policy", "a=act:act", "--tasks", "RaiseCube", "--episodes", "1"];
    let weights = dir.path().join("act/single/model.safetensors");
    let whole = fs::read(&weights).unwrap();
    fs::write(&weights, &whole[..whole.len() / 2]).unwrap();
    assert_rejected(dir.path(), &args, &["model.safetensors"]);
    fs::write(&weights, b"{}").unwrap();
    assert_rejected(dir.path(), &args, &["model.safetensors"]);
    fs::remove_file(&weights).unwrap();
    assert_rejected(dir.path(), &args, &["model.safetensors"]);
    assert_rejected(dir.path(), &["run", "--policy", "a=act:nowhere", "--tasks", "RaiseCube"], &["nowhere"]);

    let checkpoint = ["checkpoint", "-o", "pi05", "--kind", "pi05", "--size", "tiny"];
    let _ = run(dir.path(), &checkpoint).expect_code(0);
    let args = ["run", "--policy", "a=pi05:pi05", "--tasks", "RaiseCube", "--episodes", "1"];
    let bimanual = ["run", "--policy", "a=pi05:pi05", "--tasks", "DualArmPushBox", "--episodes", "1"];
    assert_rejected(dir.path(), &bimanual, &["single", "bimanual"]);
    fs::remove_file(dir.path().join("pi05/tokenizer.model")).unwrap();
    assert_rejected(dir.path(), &args, &["tokenizer.model", "PaliGemma"]);
    let options = ["run", "--policy", "a=pi05:pi05?steps=none", "--tasks", "RaiseCube"];
    assert_rejected(dir.path(), &options, &["?steps=N", "none"]);
}

#[test]
fn checkpoint_requires_its_own_control_mode() {
    let dir = tempfile::tempdir().unwrap();
    copy_checkpoint(dir.path());
    let config = dir.path().join("act/single/config.json");
    let text = fs::read_to_string(&config).unwrap();
    assert!(text.contains("pd_ee_delta_pose"), "{text}");
    fs::write(&config, text.replace("pd_ee_delta_pose", "pd_ee_pose")).unwrap();
    let args = ["run", "--policy", "a=act:act", "--tasks", "RaiseCube", "--episodes", "1", "--db", "x.db"];
    assert_rejected(dir.path(), &args, &["single robot in pd_ee_pose", "run in pd_ee_delta_pose"]);
    run(dir.path(), &[&args[..], &["--control-mode", "pd_ee_pose"]].concat()).expect_code(0);
    assert_eq!(rows(&dir.path().join("x.db")).len(), 1);
}

#[test]
fn insufficient_shared_memory_is_rejected_before_allocation() {
    let dir = tempfile::tempdir().unwrap();
    // With the largest batches, each policy that needs images takes more than 250 MB: enough policies to
    // exceed any /dev/shm.
    let free = rustix::fs::statvfs("/dev/shm").unwrap();
    let n_policies = free.f_blocks * free.f_frsize / 250_000_000 + 1;
    let policies: Vec<String> = (0..n_policies).map(|i| format!("a{i}=act:{}", act_tiny())).collect();
    let mut args = vec!["run", "--tasks", "RaiseCube", "--episodes", "1", "--envs", "4096"];
    policies.iter().for_each(|policy| args.extend(["--policy", policy]));
    assert_rejected(dir.path(), &args, &["/dev/shm", "--envs"]);
}

#[test]
fn foreign_or_mismatched_results_file_is_left_untouched() {
    let dir = tempfile::tempdir().unwrap();
    let run_into = |db: &'static str, seed: &'static str| {
        ["run", "--policy", "idle", "--tasks", "RaiseCube", "--episodes", "1", "--db", db, "--seed", seed]
    };
    fs::write(dir.path().join("notes.txt"), "these are notes, not results").unwrap();
    assert_rejected(dir.path(), &run_into("notes.txt", "0"), &["notes.txt"]);
    assert_eq!(fs::read_to_string(dir.path().join("notes.txt")).unwrap(), "these are notes, not results");

    let other = rusqlite::Connection::open(dir.path().join("other.db")).unwrap();
    other.execute_batch("CREATE TABLE episodes (name TEXT); PRAGMA user_version = 99;").unwrap();
    drop(other);
    assert_rejected(dir.path(), &run_into("other.db", "0"), &["other.db"]);

    let _ = run(dir.path(), &run_into("mine.db", "0")).expect_code(0);
    let before = rows(&dir.path().join("mine.db"));
    assert_rejected(dir.path(), &run_into("mine.db", "1"), &["mine.db", "seed"]);
    assert_eq!(rows(&dir.path().join("mine.db")), before);
}

#[test]
fn tasks_command_lists_the_whole_suite() {
    let dir = tempfile::tempdir().unwrap();
    let listed = run(dir.path(), &["tasks"]).expect_code(0);
    let matrix = run(dir.path(), &["tasks", "--matrix"]).expect_code(0);
    for task in sim::TaskId::ALL {
        assert!(
            listed.stdout.contains(task.name()) && matrix.stdout.contains(task.name()),
            "{}",
            task.name()
        );
    }
    for perturbation in sim::Perturbation::ALL {
        assert!(matrix.stdout.contains(perturbation.name()), "{}", perturbation.name());
    }
    let json = run(dir.path(), &["tasks", "--json"]).expect_code(0);
    let value: serde_json::Value = serde_json::from_str(&json.stdout).unwrap();
    assert!(value.to_string().contains("RaiseCube"));
}

#[test]
fn json_output_is_one_object_on_stdout() {
    let dir = tempfile::tempdir().unwrap();
    let args =
        ["run", "--policy", "idle", "--tasks", "RaiseCube", "--episodes", "2", "--db", "r.db", "--json"];
    let finished = run(dir.path(), &args).expect_code(0);
    let value: serde_json::Value = serde_json::from_str(&finished.stdout).unwrap();
    let cell = &value["cells"][0];
    assert_eq!((cell["n"].as_u64(), cell["success_once"].as_f64()), (Some(2), Some(0.0)), "{cell}");
    assert!(value["fps"]["env_steps_per_s"].as_f64().unwrap() > 0.0);
    assert!(value["run"].is_object() && value["ledger"].is_object());
}

/// Returns the width, height and number of frames of a PNG file.
fn png_size(path: &Path) -> ([u32; 2], u32) {
    let reader = png::Decoder::new(BufReader::new(File::open(path).unwrap())).read_info().unwrap();
    let info = reader.info();
    ([info.width, info.height], info.animation_control().map_or(1, |control| control.num_frames))
}

#[test]
fn show_writes_a_sheet() {
    let dir = tempfile::tempdir().unwrap();
    let finished = run(dir.path(), &["show", "RaiseCube", "-o", "x.png"]).expect_code(0);
    assert!(finished.stdout.is_empty(), "{}", finished.stdout);
    let path = dir.path().join("x.png");
    assert!(fs::metadata(&path).unwrap().len() > 20_000);
    let (row, _) = png_size(&path);
    let _ = run(dir.path(), &["show", "RaiseCube", "--episodes", "3", "-o", "x.png"]).expect_code(0);
    let (rows, _) = png_size(&path);
    assert_eq!([rows[0], rows[1] - 4], [row[0], (row[1] - 4) * 3]);
    let _ = run(dir.path(), &["show", "RaiseCube", "--image-size", "640x480", "-o", "x.png"]).expect_code(0);
    let (wide, _) = png_size(&path);
    assert!(wide[0] > 3 * 640 && wide[1] > 480, "{wide:?}");
}

#[test]
fn show_draws_a_row_per_applicable_perturbation() {
    let dir = tempfile::tempdir().unwrap();
    let args = ["show", "RaiseCube", "--perturbation", "all", "-o", "x.png"];
    let stdout = run(dir.path(), &args).expect_code(0).stdout;
    let nominal = (sim::TaskId::RaiseCube.task().nominal)(sim::Profile::Strict);
    let names = sim::Perturbation::ALL.iter().filter(|p| p.applies_to(&nominal).is_ok()).map(|p| p.name());
    let rows: Vec<&str> = stdout.lines().skip(1).map(|line| line.split("  ").next().unwrap()).collect();
    assert_eq!(rows, names.collect::<Vec<_>>());
    assert!(stdout.contains(sim::TaskId::RaiseCube.task().instruction), "{stdout}");
    let (size, _) = png_size(&dir.path().join("x.png"));
    // Below the images of a row stand its name, and an instruction that differs, in lines of 16 px.
    let caption_lines = (size[1] - 4 - rows.len() as u32 * (2 * 224 + 4)) / 16;
    assert!((rows.len()..=3 * rows.len()).contains(&(caption_lines as usize)), "{caption_lines}");
    assert_rejected(
        dir.path(),
        &[&args[..], &["--episodes", "2"]].concat(),
        &["--perturbation all", "--episodes"],
    );
}

#[test]
fn perturbations_compose_and_scale_with_strength() {
    let dir = tempfile::tempdir().unwrap();
    let args = ["run", "--policy", "idle", "--tasks", "RaiseCube", "--episodes", "1", "--db", "x.db"];
    let with = |perturbations, more: &[&'static str]| {
        [&args[..], &["--perturbations", perturbations], more].concat()
    };
    let half = with("Light-Color+MO-Color,MO-Color", &["--strength", "0.5"]);
    let stdout = run(dir.path(), &half).expect_code(0).stdout;
    assert!(stdout.contains("MO-Color+Light-Color"), "{stdout}");
    assert_eq!(rows(&dir.path().join("x.db")).len(), 2);
    // A results file holds one strength only.
    assert_rejected(dir.path(), &with("MO-Color", &[]), &["x.db", "strength", "0.5"]);
    assert_rejected(
        dir.path(),
        &with("Language-None+Language-Random", &[]),
        &["Language-None", "single instruction"],
    );
    assert_rejected(
        dir.path(),
        &["show", "RaiseCube", "--strength", "2"],
        &["strength is 2", "from 0.001 to 1"],
    );
}

#[test]
fn show_prints_a_legend_for_depth_and_segmentation() {
    let dir = tempfile::tempdir().unwrap();
    let shown = |what| run(dir.path(), &["show", "StackCube", "--what", what]).expect_code(0).stdout;
    let depth = shown("depth");
    let range: Vec<f32> = depth
        .trim()
        .strip_prefix("depth ")
        .and_then(|rest| rest.strip_suffix(" m"))
        .map(|range| range.split("..").map(|bound| bound.parse().unwrap()).collect())
        .unwrap();
    assert!(range.len() == 2 && 0.05 <= range[0] && range[0] < range[1] && range[1] <= 4.0, "{depth}");
    let legend = shown("seg");
    for entry in ["red cube", "green cube", "arm 1", "table", "floor", "nothing  "] {
        let line = legend.lines().find(|line| line.starts_with(entry)).unwrap();
        assert!(line.contains(" #"), "{line}");
    }
}

#[test]
fn movie_has_one_frame_per_control_step() {
    let dir = tempfile::tempdir().unwrap();
    let n_frames = sim::TaskId::RaiseCube.task().max_steps + 1;
    let movie = |name: &str, more: &[&str]| {
        let args = [&["show", "RaiseCube", "--movie", name], more].concat();
        let _ = run(dir.path(), &args).expect_code(0);
        dir.path().join(name)
    };
    let (size, n_png_frames) = png_size(&movie("x.png", &["--policy", "idle"]));
    assert_eq!((size, n_png_frames), ([2 * 228 + 228 + 4, 228 + 4 + 2 * 16], n_frames));

    let file = File::open(movie("x.gif", &["--what", "seg"])).unwrap();
    let mut decoder = gif::Decoder::new(file).unwrap();
    assert_eq!([u32::from(decoder.width()), u32::from(decoder.height())], size);
    let mut n_gif_frames = 0;
    while let Some(frame) = decoder.next_frame_info().unwrap() {
        assert_eq!(frame.delay, 5, "frame delay in units of 10 ms");
        n_gif_frames += 1;
    }
    assert_eq!(n_gif_frames, n_frames);
    let mut left: Vec<_> =
        fs::read_dir(dir.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["x.gif", "x.png"]);
}

const MP4: [&str; 8] = ["show", "RaiseCube", "--policy", "idle", "--camera", "1", "--movie", "x.mp4"];

#[test]
fn mp4_without_ffmpeg_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let without = finish(hypogeum(dir.path(), &MP4).env("PATH", dir.path()).spawn().unwrap()).expect_code(2);
    assert!(without.stderr.contains("apt install ffmpeg"), "{}", without.stderr);
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
#[ignore = "needs ffmpeg"]
fn movies_are_written_as_mp4() {
    let dir = tempfile::tempdir().unwrap();
    // The second run replaces the file, which it recognises as the program's own.
    for _ in 0..2 {
        let _ = run(dir.path(), &MP4).expect_code(0);
        assert_eq!(&fs::read(dir.path().join("x.mp4")).unwrap()[4..8], b"ftyp");
    }
}

#[test]
fn interrupted_movie_leaves_no_file() {
    let dir = tempfile::tempdir().unwrap();
    let child = hypogeum(dir.path(), &["show", "StackCube", "--movie", "x.apng"]).spawn().unwrap();
    let start = Instant::now();
    while !dir.path().join("x.apng.part").exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "the movie was not started within 60 s");
        std::thread::sleep(Duration::from_millis(1));
    }
    let pid = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
    let finished = finish(child).expect_code(130);
    assert!(finished.stderr.contains("x.apng is not written"), "{}", finished.stderr);
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn show_rejects_invalid_options() {
    let dir = tempfile::tempdir().unwrap();
    let rejected =
        |more: &[&str], words| assert_rejected(dir.path(), &[&["show", "RaiseCube"], more].concat(), words);
    rejected(&["-o", "absent/x.png"], &["absent/x.png"]);
    rejected(&["--movie", "absent/x.gif"], &["absent/x.gif"]);
    rejected(&["--movie", "x.avi"], &["x.avi", ".png, .apng, .gif, .mp4"]);
    rejected(&["--camera", "4"], &["RaiseCube has 3 cameras"]);
    rejected(&["--what", "deep"], &["deep", "depth"]);
    rejected(&["--policy", "random"], &["random", "expert", "idle"]);
    rejected(&["--episodes", "0"], &["--episodes", "1..=64"]);
    rejected(&["--episodes", "2", "--movie", "x.gif"], &["--episodes", "--movie"]);
    rejected(&["--episodes", "2", "--policy", "idle"], &["--episodes", "--policy"]);
    rejected(&["--movie", "x.gif", "-o", "x.png"], &["--movie", "--output"]);
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
}
