//! Checkpoint folders: ACT in both formats, and π0.5 in LeRobot's and openpi's.

use std::path::Path;
use std::sync::LazyLock;

use ipc_types::{ControlMode, Morphology, ObservationView};
use policy_host::{ActionChunk, PolicySpec, QueryMode, check, load};
use run_config::{QueryOptions, error_chain};
use serde_json::Value;

use super::edits::Edits;
use super::frame::valid_observation;
use super::{refused, repository};

/// A valid checkpoint in memory.
struct SampleCheckpoint {
    kind: &'static str,
    /// Paths within the folder, and contents.
    files: Vec<(String, Vec<u8>)>,
}

static SAMPLES: LazyLock<Vec<SampleCheckpoint>> = LazyLock::new(|| {
    let act = ["act-tiny/single", "lerobot/cameras", "lerobot/env_state", "lerobot/older", "lerobot/robot"];
    let pi05 = ["pi05/robot", "pi05/bf16", "pi05/missing", "pi05/one_camera"];
    let sample = |kind| move |name: &&str| SampleCheckpoint { kind, files: files(&[name]) };
    let mut openpi = SampleCheckpoint { kind: "pi05", files: files(&["pi05/one_camera", "pi05/openpi"]) };
    openpi.files.retain(|(name, _)| !name.starts_with("policy_") && name != "config.json");
    for (name, bytes) in &mut openpi.files {
        if name == "model.safetensors" {
            rename_tensors(bytes);
        }
    }
    act.iter().map(sample("act")).chain(pi05.iter().map(sample("pi05"))).chain([openpi]).collect()
});

/// Reads the files of folders of test data, of which later ones replace earlier ones.
fn files(folders: &[&str]) -> Vec<(String, Vec<u8>)> {
    fn collect(root: &Path, folder: &Path, files: &mut Vec<(String, Vec<u8>)>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(root).unwrap().to_str().unwrap().to_owned();
            if path.is_dir() {
                collect(root, &path, files);
            } else if !name.starts_with("io.") && !name.starts_with("reference") {
                files.retain(|(other, _)| *other != name);
                files.push((name, std::fs::read(&path).unwrap()));
            }
        }
    }
    let mut files = Vec::new();
    for folder in folders {
        let root = repository("policy-host/tests/data").join(folder);
        collect(&root, &root, &mut files);
    }
    files.sort();
    files
}

/// Turns LeRobot's tensor names into openpi's.
fn rename_tensors(file: &mut Vec<u8>) {
    edit_header(file, |header| {
        let Value::Object(tensors) = header else { panic!("a header is an object") };
        let renamed = std::mem::take(tensors).into_iter();
        *tensors = renamed
            .map(|(name, info)| (name.strip_prefix("model.").unwrap_or(&name).to_owned(), info))
            .collect();
    });
}

/// Changes the header of a safetensors file, and the length before it.
fn edit_header(file: &mut Vec<u8>, edit: impl FnOnce(&mut Value)) {
    let Some((length, rest)) = file.split_first_chunk::<8>() else { return };
    let length = u64::from_le_bytes(*length) as usize;
    let Some(Ok(mut header)) = rest.get(..length).map(serde_json::from_slice) else { return };
    edit(&mut header);
    let text = header.to_string();
    let data = rest[length..].iter().copied();
    *file = (text.len() as u64).to_le_bytes().into_iter().chain(text.into_bytes()).chain(data).collect();
}

/// Checks a checkpoint, loads it, and queries the policy.
///
/// # Panics
/// If an error is unclear.
pub fn run(data: &[u8]) -> bool {
    let mut edits = Edits::new(data);
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("the-checkpoint");
    let sample = edits.pick(&SAMPLES);
    let kind = if edits.below(4) == 1 { format!("{}-int8", sample.kind) } else { sample.kind.to_owned() };
    let mut files = sample.files.clone();
    for _ in 0..=edits.below(3) {
        edit_file(&mut edits, &mut files);
    }
    for (name, bytes) in &files {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    let steps = if sample.kind == "pi05" { "?steps=1" } else { "" };
    let spec: PolicySpec = format!("{kind}:{}{steps}", folder.display()).parse().unwrap();
    if let Err(error) =
        check(&spec, &[(Morphology::Single, ControlMode::EeDeltaPose)], QueryOptions::default())
    {
        assert!(!refused(&error_chain(&error), &folder));
    }
    match load(&spec, 1, QueryMode::Chunk, &Morphology::ALL) {
        Ok(mut policy) => {
            let (header, pages) = valid_observation(&mut Edits::new(&[0, 0, 1]));
            let view = ObservationView::new(header, &pages).unwrap();
            let _ = policy.act(&view, &mut vec![ActionChunk::default(); view.n_envs()]);
            true
        }
        Err(error) => refused(&error_chain(&error), &folder),
    }
}

fn edit_file(edits: &mut Edits<'_>, files: &mut Vec<(String, Vec<u8>)>) {
    if files.is_empty() || edits.is_empty() {
        return;
    }
    let idx = edits.below(files.len());
    let other = edits.pick(&SAMPLES);
    match edits.below(16) {
        0 => drop(files.remove(idx)),
        1 => files.push(edits.pick(&other.files).clone()),
        2 => files.push(("hypogeum.json".to_owned(), edits.json(SIDECAR))),
        _ => {
            let (name, bytes) = &mut files[idx];
            if name.ends_with(".json") {
                *bytes = edits.json(bytes);
            } else if edits.below(2) == 0 {
                edit_header(bytes, |header| edits.value(header));
            } else {
                edits.bytes(bytes);
            }
        }
    }
}

/// A mapping file with every key.
const SIDECAR: &[u8] = br#"{
    "morphology": "single", "control_mode": "pd_ee_delta_pose",
    "mapping": {"observation.images.hand": "hand_camera", "observation.state": ["qpos", "tcp_pose"],
        "observation.environment_state": "language", "left_wrist_0_rgb": "none"},
    "language": {"encoder": "clip-vit-b-32", "weights": "clip", "fingerprint": "0123456789abcdef"},
    "vision_heads": 3, "prompt_state": "padded", "chunk_size": 10
}"#;
