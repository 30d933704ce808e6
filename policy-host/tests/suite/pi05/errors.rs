//! Errors of π0.5 checkpoints: each names the file, the tensor or key, and what was expected.

use std::path::Path;

use ipc_types::Morphology;
use policy_host::formats::mapping::PromptState;
use policy_host::models::pi05::checkpoint::Pi05Checkpoint;
use policy_host::{ActionChunk, PolicySpec, QueryMode, load};
use run_config::error_chain;
use safetensors::tensor::TensorView;
use serde_json::Value;
use tempfile::TempDir;

use super::{Rewritten, copy_of, rewrite};
use crate::assert_contains;
use crate::batch::ObservationBatch;

/// Returns the error of loading a folder.
fn error_of(folder: &Path) -> String {
    let spec: PolicySpec = format!("pi05:{}", folder.display()).parse().unwrap();
    let error = load(&spec, 1, QueryMode::Chunk, &Morphology::ALL).err().expect("an error");
    error_chain(&error)
}

/// Copies `robot`, changes its weights and returns the error.
fn error_with(change: impl Fn(&str, &TensorView<'_>) -> Option<Rewritten>) -> String {
    let folder = copy_of("robot");
    let path = folder.path().join("model.safetensors");
    rewrite(&path.clone(), &folder.path().join("changed"), change);
    std::fs::rename(folder.path().join("changed"), path).unwrap();
    error_of(folder.path())
}

#[test]
fn damaged_weights_are_named() {
    let unchanged =
        |name: &str, view: &TensorView<'_>| (name.to_owned(), view.shape().to_vec(), view.data().to_vec());
    let gate = "model.paligemma_with_expert.gemma_expert.model.layers.1.mlp.gate_proj.weight";
    let error = error_with(|name, view| (name != gate).then(|| unchanged(name, view)));
    assert_contains(&error, &[gate, "is missing", "[32, 16]"]);

    let error = error_with(|name, view| {
        let (name, mut shape, bytes) = unchanged(name, view);
        if name == gate {
            shape.reverse();
        }
        Some((name, shape, bytes))
    });
    assert_contains(&error, &[gate, "F32 [16, 32]", "F32 [32, 16]"]);

    let error = error_with(|name, view| {
        let (name, shape, mut bytes) = unchanged(name, view);
        if name == gate {
            bytes[40..44].copy_from_slice(&f32::NAN.to_le_bytes());
        }
        Some((name, shape, bytes))
    });
    assert_contains(&error, &[gate, "not finite"]);

    // A tensor of π0 in place of one that nothing reads.
    let error = error_with(|name, view| {
        let is_unused = name == "model.paligemma_with_expert.gemma_expert.lm_head.weight";
        Some(unchanged(if is_unused { "model.state_proj.weight" } else { name }, view))
    });
    assert_contains(&error, &["model.state_proj.weight", "not part of the network"]);
}

#[test]
fn damaged_shards_are_named() {
    let folder = copy_of("bf16");
    let shard = folder.path().join("model-00002-of-00002.safetensors");
    let bytes = std::fs::read(&shard).unwrap();
    std::fs::write(&shard, &bytes[..bytes.len() - 100]).unwrap();
    assert_contains(&error_of(folder.path()), &["model-00002-of-00002.safetensors", "truncated"]);
    std::fs::remove_file(&shard).unwrap();
    assert_contains(&error_of(folder.path()), &["model-00002-of-00002.safetensors", "failed to read"]);
    std::fs::write(folder.path().join("model.safetensors.index.json"), r#"{"weight_map": {"a": "../b"}}"#)
        .unwrap();
    assert_contains(&error_of(folder.path()), &["model.safetensors.index.json", "../b", "same folder"]);
    std::fs::write(folder.path().join("model.safetensors.index.json"), r#"{"weight_map": {}}"#).unwrap();
    assert_contains(&error_of(folder.path()), &["model.safetensors.index.json", "no tensor"]);
}

#[test]
fn unfit_vocabularies_are_named() {
    let folder = copy_of("robot");
    let path = folder.path().join("tokenizer.model");
    let bytes = std::fs::read(&path).unwrap();
    for len in [0, 1, 7, 100, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(&path, &bytes[..len]).unwrap();
        assert_contains(&error_of(folder.path()), &["tokenizer.model"]);
    }
    std::fs::remove_file(&path).unwrap();
    assert_contains(&error_of(folder.path()), &["tokenizer.model", "is missing", "PaliGemma"]);
}

/// Whatever the files of a checkpoint contain, loading it ends with a policy that answers, or an error.
#[test]
fn mutated_files_never_panic() {
    const FILES: [&str; 7] = [
        "config.json",
        "hypogeum.json",
        "tokenizer.model",
        "model.safetensors.index.json",
        "model-00001-of-00002.safetensors",
        "policy_preprocessor.json",
        "policy_preprocessor_step_3_normalizer_processor.safetensors",
    ];
    const N_MUTATIONS: usize = 50;
    let folder = copy_of("bf16");
    let spec: PolicySpec = format!("pi05:{}", folder.path().display()).parse().unwrap();
    let mut n_errors = 0;
    for name in FILES {
        let path = folder.path().join(name);
        let whole = std::fs::read(&path).unwrap();
        let stream = policy_host::generated::fnv1a64(name);
        let draw = |idx: usize, limit: usize| {
            (policy_host::generated::unit(stream, idx) * limit as f32) as usize % limit
        };
        for mutation in 0..N_MUTATIONS {
            let mut bytes = whole.clone();
            // The header of a weights file is at its start.
            let range = bytes.len().min(8192);
            for change in 0..1 + mutation % 3 {
                let at = draw(16 * mutation + 2 * change, range);
                bytes[at] = draw(16 * mutation + 2 * change + 1, 256) as u8;
            }
            std::fs::write(&path, bytes).unwrap();
            let Ok(mut policy) = load(&spec, 1, QueryMode::Chunk, &Morphology::ALL) else {
                n_errors += 1;
                continue;
            };
            let batch = ObservationBatch::of(Morphology::Single, &[0]);
            let _ = policy.act(&batch.view(), &mut [ActionChunk::default()]);
        }
        std::fs::write(&path, whole).unwrap();
    }
    assert!(load(&spec, 1, QueryMode::Chunk, &Morphology::ALL).is_ok());
    assert!(n_errors > FILES.len() * N_MUTATIONS / 4, "only {n_errors} mutations were noticed");
}

#[test]
fn unsupported_configurations_are_named() {
    let cases = [
        (r#""type": "pi05""#, r#""type": "pi0""#, &["`pi0`", "`pi05`"][..]),
        (r#""n_obs_steps": 1"#, r#""n_obs_steps": 2"#, &["n_obs_steps", "2"]),
        (r#""use_relative_actions": false"#, r#""use_relative_actions": true"#, &["use_relative_actions"]),
        (r#""max_action_dim": 32"#, r#""max_action_dim": 24"#, &["max_action_dim", "24", "32"]),
        (r#""num_inference_steps": 10"#, r#""num_inference_steps": 0"#, &["num_inference_steps"]),
        (r#""chunk_size": 10"#, r#""chunk_size": 0"#, &["chunk_size"]),
        (r#""chunk_size": 10"#, r#""chunk_size": 1000000000000"#, &["chunk_size", "1 to 1024"]),
        (r#""num_inference_steps": 10"#, r#""num_inference_steps": 100000000"#, &["num_inference_steps"]),
        (r#""tokenizer_max_length": 160"#, r#""tokenizer_max_length": 0"#, &["tokenizer_max_length"]),
        (r#""min_period": 0.004"#, r#""min_period": -1.0"#, &["min_period", "-1"]),
    ];
    for (from, to, expected) in cases {
        let folder = copy_of("robot");
        let path = folder.path().join("config.json");
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{from}");
        std::fs::write(&path, text.replace(from, to)).unwrap();
        assert_contains(&error_of(folder.path()), expected);
    }
    let folder = copy_of("robot");
    std::fs::write(folder.path().join("hypogeum.json"), r#"{"vision_heads": 5}"#).unwrap();
    assert_contains(&error_of(folder.path()), &["vision_heads", "5", "24"]);
    let empty = TempDir::new().unwrap();
    assert_contains(&error_of(empty.path()), &["no checkpoint in", "single"]);
}

#[test]
fn prompt_convention_follows_from_the_version() {
    let folder = copy_of("robot");
    let described = || {
        let checkpoint = Pi05Checkpoint::open(folder.path()).unwrap();
        let description = checkpoint.description();
        (description.prompt_state, description.padding_value, description.notes.join("; "))
    };
    let (prompt_state, padding_value, notes) = described();
    assert_eq!((prompt_state, padding_value), (PromptState::Unpadded, -1.0));
    assert!(!notes.contains("was written by"), "{notes}");
    let config = folder.path().join("config.json");
    let mut settings: Value = serde_json::from_slice(&std::fs::read(&config).unwrap()).unwrap();
    settings.as_object_mut().unwrap().remove("use_relative_actions");
    std::fs::write(&config, settings.to_string()).unwrap();
    let (prompt_state, padding_value, notes) = described();
    assert_eq!((prompt_state, padding_value), (PromptState::Padded, -3.0));
    assert_contains(&notes, &["written by LeRobot before 0.5.1", "no `use_relative_actions`"]);
    let training = folder.path().join("train_config.json");
    std::fs::write(&training, r#"{"seed": 1000}"#).unwrap();
    let (prompt_state, _, notes) = described();
    assert_eq!(prompt_state, PromptState::Padded);
    assert_contains(&notes, &["train_config.json has no `cudnn_deterministic`"]);
    std::fs::write(&training, r#"{"cudnn_deterministic": false}"#).unwrap();
    assert_eq!(described().0, PromptState::Unpadded);
    std::fs::write(&training, "[").unwrap();
    assert_contains(&error_of(folder.path()), &["train_config.json"]);
}
