//! π0.5 checkpoints with generated weights, in LeRobot's format: bf16, in shards, streamed to disk.
//!
//! Values follow the rules of the [parent module](super), with one exception: scales of RMS normalisations,
//! to which Gemma adds one, are within ±0.1. The vocabulary is of single bytes and characters.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use half::bf16;
use ipc_types::{ControlMode, Morphology};
use rayon::prelude::*;
use serde_json::{Value, json};

use super::{WriteCheckpointError, element};
use crate::formats::mapping::MAPPING_FILE;
use crate::models::pi05::architecture::Pi05Architecture;
use crate::models::pi05::checkpoint::names::Pi05Names;
use crate::text::paligemma::TOKENIZER_FILE;
use crate::weights::{CONFIG_FILE, INDEX_FILE, TensorSpec};

/// Size of a shard above which the next one begins.
const SHARD_BYTES: usize = 2 << 30;
/// Values that are generated at a time.
const BLOCK_LEN: usize = 4 << 20;
/// Number of SentencePiece's kind of ordinary pieces.
const NORMAL: u64 = 1;
/// Number of SentencePiece's kind of the piece for unknown characters.
const UNKNOWN: u64 = 2;
/// Number of SentencePiece's kind of pieces that never occur in a text.
const CONTROL: u64 = 3;
/// Number of SentencePiece's kind of single bytes.
const BYTE: u64 = 6;

/// Writes a checkpoint with generated weights to `folder`, creating it if necessary. Calls `progress(bytes)`
/// as bytes of weights are written.
///
/// # Errors
/// If a file cannot be written.
pub fn write_pi05_checkpoint(
    folder: &Path,
    architecture: &Pi05Architecture,
    morphology: Morphology,
    seed: u64,
    mut progress: impl FnMut(u64),
) -> Result<(), WriteCheckpointError> {
    let at = |path: &Path| {
        let path = path.to_owned();
        |source| WriteCheckpointError::Io { path, source }
    };
    std::fs::create_dir_all(folder).map_err(at(folder))?;
    for (name, value) in configuration(architecture, morphology) {
        let path = folder.join(name);
        std::fs::write(&path, format!("{value:#}\n")).map_err(at(&path))?;
    }
    let path = folder.join(TOKENIZER_FILE);
    std::fs::write(&path, byte_vocabulary()).map_err(at(&path))?;

    let shards = shards(architecture.tensor_specs(&Pi05Names::LEROBOT));
    let mut weight_map = BTreeMap::new();
    for (idx, specs) in shards.iter().enumerate() {
        let name = format!("model-{:05}-of-{:05}.safetensors", idx + 1, shards.len());
        let path = folder.join(&name);
        write_shard(&path, specs, seed, &mut progress).map_err(at(&path))?;
        weight_map.extend(specs.iter().map(|spec| (spec.name.clone(), name.clone())));
    }
    let path = folder.join(INDEX_FILE);
    let index = json!({"metadata": {}, "weight_map": weight_map});
    std::fs::write(&path, format!("{index:#}\n")).map_err(at(&path))
}

/// Returns the number of bytes of the weights that [`write_pi05_checkpoint`] writes.
#[must_use]
pub fn pi05_bytes(architecture: &Pi05Architecture) -> u64 {
    architecture.tensor_specs(&Pi05Names::LEROBOT).iter().map(n_bytes).sum::<usize>() as u64
}

/// Tokens of a prompt, LeRobot's default.
const MAX_TOKENS: usize = 200;

/// Returns the names and contents of the JSON files.
fn configuration(architecture: &Pi05Architecture, morphology: Morphology) -> [(&'static str, Value); 4] {
    let side = architecture.image_side();
    let state_dim: usize = morphology.state_parts()[0].1;
    let control_mode = match morphology {
        Morphology::Single => ControlMode::EeDeltaPose,
        Morphology::Bimanual => ControlMode::JointPos,
    };
    let mut inputs = serde_json::Map::new();
    for camera in morphology.camera_names() {
        let name = camera.strip_suffix("_camera").unwrap_or(camera);
        inputs.insert(
            format!("observation.images.{name}"),
            json!({"type": "VISUAL", "shape": [3, side, side]}),
        );
    }
    inputs.insert("observation.state".to_owned(), json!({"type": "STATE", "shape": [state_dim]}));
    let outputs = json!({"action": {"type": "ACTION", "shape": [control_mode.action_dim(morphology)]}});
    let modes = json!({"VISUAL": "IDENTITY", "STATE": "IDENTITY", "ACTION": "IDENTITY"});
    let step = |name: &str, config: Value| json!({"registry_name": name, "config": config});
    let normaliser =
        |name: &str, features: Value| step(name, json!({"features": features, "norm_map": modes}));
    let before = [
        normaliser("normalizer_processor", json!(inputs)),
        step("pi05_prepare_state_tokenizer_processor_step", json!({})),
        step("tokenizer_processor", json!({"max_length": MAX_TOKENS})),
    ];
    let after = [normaliser("unnormalizer_processor", outputs.clone())];
    [
        (
            CONFIG_FILE,
            json!({
                "type": "pi05",
                "input_features": inputs,
                "output_features": outputs,
                "normalization_mapping": modes,
                "chunk_size": architecture.horizon,
                "n_action_steps": architecture.horizon,
                "max_action_dim": architecture.action_width,
                "image_resolution": [side, side],
                "dtype": "bfloat16",
                "use_relative_actions": false,
            }),
        ),
        ("policy_preprocessor.json", json!({"name": "policy_preprocessor", "steps": before})),
        ("policy_postprocessor.json", json!({"name": "policy_postprocessor", "steps": after})),
        (
            MAPPING_FILE,
            json!({
                "morphology": morphology.name(),
                "control_mode": control_mode.name(),
                "vision_heads": architecture.vision.num_attention_heads,
            }),
        ),
    ]
}

/// Divides tensors among shards.
fn shards(specs: Vec<TensorSpec>) -> Vec<Vec<TensorSpec>> {
    let mut shards = vec![Vec::new()];
    let mut size = 0;
    for spec in specs {
        if size > 0 && size + n_bytes(&spec) > SHARD_BYTES {
            shards.push(Vec::new());
            size = 0;
        }
        size += n_bytes(&spec);
        if let Some(shard) = shards.last_mut() {
            shard.push(spec);
        }
    }
    shards
}

fn n_bytes(spec: &TensorSpec) -> usize {
    2 * spec.shape.iter().product::<usize>()
}

fn write_shard(
    path: &Path,
    specs: &[TensorSpec],
    seed: u64,
    progress: &mut impl FnMut(u64),
) -> std::io::Result<()> {
    let mut header = serde_json::Map::new();
    let mut end = 0;
    for spec in specs {
        let start = end;
        end += n_bytes(spec);
        let entry = json!({"dtype": "BF16", "shape": spec.shape, "data_offsets": [start, end]});
        header.insert(spec.name.clone(), entry);
    }
    let mut header = Value::Object(header).to_string();
    // Padding aligns the values.
    header.push_str(&" ".repeat(header.len().next_multiple_of(8) - header.len()));
    let mut file = BufWriter::new(File::create(path)?);
    file.write_all(&(header.len() as u64).to_le_bytes())?;
    file.write_all(header.as_bytes())?;
    for spec in specs {
        let rule = element(spec, seed, is_added_to_one(&spec.name));
        let len: usize = spec.shape.iter().product();
        for first in (0..len).step_by(BLOCK_LEN) {
            let block = first..len.min(first + BLOCK_LEN);
            let values: Vec<[u8; 2]> =
                block.into_par_iter().map(|idx| bf16::from_f32(rule(idx)).to_le_bytes()).collect();
            file.write_all(values.as_flattened())?;
            progress(2 * values.len() as u64);
        }
    }
    file.flush()
}

/// Returns `true` for the scales of Gemma's normalisations.
fn is_added_to_one(name: &str) -> bool {
    name.ends_with("layernorm.weight")
}

/// Returns a SentencePiece model of bytes and printable characters.
fn byte_vocabulary() -> Vec<u8> {
    let mut model = Vec::new();
    let controls = [("<pad>", CONTROL), ("<eos>", CONTROL), ("<bos>", CONTROL), ("<unk>", UNKNOWN)];
    let controls = controls.map(|(piece, kind)| (piece.to_owned(), kind));
    let bytes = (0..=u8::MAX).map(|byte| (format!("<0x{byte:02X}>"), BYTE));
    let characters = (b'!'..=b'~').map(char::from).chain(['\u{2581}', '\n']);
    let characters = characters.map(|character| (character.to_string(), NORMAL));
    for (idx, (piece, kind)) in controls.into_iter().chain(bytes).chain(characters).enumerate() {
        let mut entry = Vec::new();
        write_bytes(&mut entry, 1, piece.as_bytes());
        entry.push(2 << 3 | 5);
        entry.extend((-(idx as f32)).to_le_bytes());
        write_number(&mut entry, 3, kind);
        write_bytes(&mut model, 1, &entry);
    }
    let mut trainer = Vec::new();
    // The type of model is byte-pair encoding; unknown characters become bytes; numbers and names
    // of the special pieces.
    for (field, value) in [(3, 2), (35, 1), (40, 3), (41, 2), (42, 1), (43, 0)] {
        write_number(&mut trainer, field, value);
    }
    for (field, name) in [(45, "<unk>"), (46, "<bos>"), (47, "<eos>"), (48, "<pad>")] {
        write_bytes(&mut trainer, field, name.as_bytes());
    }
    write_bytes(&mut model, 2, &trainer);
    let mut normaliser = Vec::new();
    write_bytes(&mut normaliser, 1, b"identity");
    // No space is added in front, none is removed, and spaces become U+2581.
    for (field, value) in [(3, 0), (4, 0), (5, 1)] {
        write_number(&mut normaliser, field, value);
    }
    write_bytes(&mut model, 3, &normaliser);
    model
}

/// Appends a field with a length, in the encoding of protocol buffers.
fn write_bytes(out: &mut Vec<u8>, field: u64, bytes: &[u8]) {
    write_varint(out, field << 3 | 2);
    write_varint(out, bytes.len() as u64);
    out.extend_from_slice(bytes);
}

/// Appends an integer field, in the encoding of protocol buffers.
fn write_number(out: &mut Vec<u8>, field: u64, value: u64) {
    write_varint(out, field << 3);
    write_varint(out, value);
}

fn write_varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}
