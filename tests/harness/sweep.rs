//! Sweep files and the arguments of `hypogeum run`.

use std::ffi::OsString;
use std::path::Path;

use orchestrator::fuzzing::{ResolvedRun, resolve_run};

use super::edits::Edits;
use super::{refused, refused_in_one_line};

/// Files with every key.
const FILES: [&str; 3] = [
    include_str!("../../first-light.toml"),
    r#"
policies = ["floor=idle", "mine=act:runs/a", "vla=pi05-int8:runs/b?steps=5", "far=attach:peer"]
tasks = ["RaiseCube", "bimanual"]
perturbations = ["None", "MO-Color+Camera-Pose", "all"]
episodes = 100
db = "a.db"
until_decided = ["floor", "mine"]
margin = 0.05
alpha = 0.01
seed = 7
profile = "paper"
strength = 0.5
mode = "chunk"
execute = 12
latency = 80
control_mode = "pd_joint_pos"
renderer = "cpu"
samples = 4
envs = 16
threads = "auto"
keep_actions = true
trace = "trace.json"
"#,
    "policies = \"idle\"\nmode = 'ensemble'\nlanguage = \"sentences.yaml\"\nstrength = 1e-1\n",
];
/// Arguments after `hypogeum run`, of which each line may be appended.
const ARGUMENTS: [&str; 6] = [
    "--policy\nidle",
    "--policy=a=pi05:b?steps=3\n--tasks=single,StackCube",
    "--perturbations\nAll,Light-Color+Table-Color\n--episodes=3",
    "--until-decided\na,idle\n--margin=0.1",
    "--seed\n18446744073709551615\n--strength=0.25\n--execute\n127",
    "--envs=8192\n--threads\n1\n--latency=10000\n--control-mode\npd_ee_pose",
];

/// Resolves a run, and resolves the sweep file that it stands for again.
///
/// # Panics
/// If an error is unclear, or the two plans differ.
pub fn run(data: &[u8]) -> bool {
    let mut edits = Edits::new(data);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sweep.toml");
    let mut words = ["hypogeum", "run"].map(OsString::from).to_vec();
    let with_file = edits.below(4) < 3;
    if with_file {
        std::fs::write(&path, edited_file(&mut edits)).unwrap();
        words.push(path.clone().into());
    }
    for _ in 0..edits.below(3) {
        let arguments = edits.word(&ARGUMENTS);
        let arguments = if edits.below(2) == 0 { edits.text(arguments) } else { arguments.to_owned() };
        words.extend(arguments.lines().map(OsString::from));
    }
    match resolve_run(&words) {
        Ok(resolved) => {
            assert_eq!(resolve_file(folder.path(), &resolved.sweep), resolved);
            true
        }
        // An error of a combination of options names the options.
        Err(message) if message.starts_with("the sweep file") => refused(&message, &path),
        // clap quotes the words as they are.
        Err(message) if message.starts_with("error: ") => false,
        Err(message) => refused_in_one_line(&message),
    }
}

fn edited_file(edits: &mut Edits<'_>) -> Vec<u8> {
    let mut text = edits.word(&FILES).as_bytes().to_vec();
    edits.bytes(&mut text);
    text
}

#[track_caller]
fn resolve_file(folder: &Path, sweep: &str) -> ResolvedRun {
    let path = folder.join("again.toml");
    std::fs::write(&path, sweep).unwrap();
    let words = [OsString::from("hypogeum"), OsString::from("run"), path.into()];
    resolve_run(&words).unwrap_or_else(|error| panic!("{error}; from\n{sweep}"))
}
