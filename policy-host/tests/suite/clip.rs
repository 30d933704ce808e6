//! CLIP's text encoder against the reference that `python/make_clip_reference.py` computed with PyTorch, and
//! errors of invalid weight files.

use std::fs;
use std::path::Path;

use ipc_types::{ControlMode, Morphology};
use policy_host::models::act::checkpoint::colosseum::ActConfig;
use policy_host::models::synthetic::{tensor, write_checkpoint};
use policy_host::text::LanguageConfig;
use policy_host::text::clip::{ClipText, ClipTokenizer, TowerShape, WeightsFingerprint};
use policy_host::weights::TensorSpec;
use policy_host::{PolicySpec, QueryMode, check, load};
use run_config::{QueryOptions, error_chain};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::Deserialize;
use tempfile::TempDir;

use crate::batch::ObservationBatch;
use crate::{act_spec, data};

/// Maximum absolute difference of an embedding entry.
const TOLERANCE: f32 = 1e-4;
/// Dimensions of the reference tower.
const TOWER: TowerShape = TowerShape { n_layers: 3, width: 128, dim: 512 };
/// Dimensions of the smallest tower with the embedding dimension of ViT-B/32.
const MIN_TOWER: TowerShape = TowerShape { n_layers: 1, width: 64, dim: 512 };
const ROBOTS: [(Morphology, ControlMode); 1] = [(Morphology::Single, ControlMode::EeDeltaPose)];

#[derive(Deserialize)]
struct Reference {
    fingerprint: WeightsFingerprint,
    texts: Vec<Text>,
}

#[derive(Deserialize)]
struct Text {
    text: String,
    ids: Vec<u16>,
}

fn reference() -> Reference {
    serde_json::from_slice(&fs::read(data("clip-tiny/reference.json")).unwrap()).unwrap()
}

/// Name, shape and values of a tensor.
type F32Tensor = (String, Vec<usize>, Vec<f32>);

/// Generates the tensors of a tower under Hugging Face's names.
fn hugging_face(shape: TowerShape) -> Vec<F32Tensor> {
    shape
        .tensors()
        .map(|spec| {
            let numbers = tensor(&spec, 0);
            let TensorSpec { name, shape } = spec;
            (name, shape, numbers)
        })
        .collect()
}

/// Generates the same tensors under OpenAI's names, with an additional tensor of the vision tower.
fn open_ai(shape: TowerShape) -> Vec<F32Tensor> {
    let renamed = [
        ("text_model.embeddings.token_embedding", "token_embedding"),
        ("text_model.embeddings.position_embedding.weight", "positional_embedding"),
        ("text_model.encoder.layers", "transformer.resblocks"),
        ("text_model.final_layer_norm", "ln_final"),
        ("text_projection.weight", "text_projection"),
        ("self_attn.q_proj.", "attn.in_proj_"),
        ("self_attn.out_proj", "attn.out_proj"),
        ("layer_norm", "ln_"),
        ("mlp.fc1", "mlp.c_fc"),
        ("mlp.fc2", "mlp.c_proj"),
    ];
    let mut list: Vec<F32Tensor> = vec![("visual.proj".to_owned(), vec![2, 1], vec![0.0; 2])];
    for (name, mut shape, mut numbers) in hugging_face(shape) {
        let base = name.replace("k_proj", "q_proj").replace("v_proj", "q_proj");
        let name = renamed.iter().fold(base, |name, (from, to)| name.replace(from, to));
        if name == "text_projection" {
            let [n_rows, n_cols] = shape[..] else { panic!("a matrix") };
            let at = |row: usize, col: usize| numbers[row * n_cols + col];
            numbers = (0..n_cols).flat_map(|col| (0..n_rows).map(move |row| at(row, col))).collect();
            shape.reverse();
        }
        // Query, key and value projections now share a name and arrive in this order.
        match list.iter_mut().find(|(known, ..)| *known == name) {
            Some((_, known_shape, known_numbers)) => {
                known_shape[0] += shape[0];
                known_numbers.extend(numbers);
            }
            None => list.push((name, shape, numbers)),
        }
    }
    list
}

/// Writes the tensors to `model.safetensors` in `folder`.
fn write(folder: &Path, tensors: &[F32Tensor]) {
    let bytes: Vec<Vec<u8>> =
        tensors.iter().map(|(.., numbers)| numbers.iter().flat_map(|x| x.to_le_bytes()).collect()).collect();
    let views = tensors.iter().zip(&bytes).map(|((name, shape, _), bytes)| {
        (name.as_str(), TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap())
    });
    fs::create_dir_all(folder).unwrap();
    safetensors::serialize_to_file(views, None, &folder.join("model.safetensors")).unwrap();
}

fn encoder(tensors: &[F32Tensor]) -> ClipText {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), tensors);
    ClipText::load(&folder.path().join("model.safetensors"), TOWER.dim).unwrap()
}

/// Writes a tiny checkpoint whose encoder is in `clip`, after applying `edit` to the encoder's tensors.
fn checkpoint(fingerprint: u64, edit: impl FnOnce(&mut Vec<F32Tensor>)) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let language =
        LanguageConfig::ClipVitB32 { weights: "clip".into(), fingerprint: WeightsFingerprint(fingerprint) };
    let config = ActConfig { language: Some(language), ..ActConfig::tiny(Morphology::Single) };
    write_checkpoint(folder.path(), &config, 0).unwrap();
    let mut tensors = hugging_face(MIN_TOWER);
    edit(&mut tensors);
    write(&folder.path().join("clip"), &tensors);
    folder
}

fn spec(folder: &TempDir) -> PolicySpec {
    act_spec(folder.path().to_owned())
}

/// Asserts that `check` and `load` return the same error and that it contains `parts`.
#[track_caller]
fn assert_rejected(folder: &TempDir, parts: &[&str]) {
    let checked = error_chain(&check(&spec(folder), &ROBOTS, QueryOptions::default()).unwrap_err());
    let loaded = error_chain(&load(&spec(folder), 1, QueryMode::Chunk, &Morphology::ALL).err().unwrap());
    assert_eq!(checked, loaded, "check and load must agree");
    for part in parts {
        assert!(checked.contains(part), "`{checked}` does not contain `{part}`");
    }
}

#[test]
fn tokens_agree_with_the_reference() {
    let tokenizer = ClipTokenizer::new();
    for Text { text, ids } in reference().texts {
        assert_eq!(tokenizer.encode(&text), ids, "{text:?}");
    }
}

#[test]
fn embeddings_agree_with_pytorch_in_both_formats() {
    let Reference { fingerprint, texts } = reference();
    let bytes = fs::read(data("clip-tiny/reference.safetensors")).unwrap();
    let tensors = SafeTensors::deserialize(&bytes).unwrap();
    let expected = tensors.tensor("embeddings").unwrap();
    assert_eq!(expected.shape(), [texts.len(), TOWER.dim]);
    let rows = expected.data().chunks_exact(4 * TOWER.dim);
    let encoders = [encoder(&hugging_face(TOWER)), encoder(&open_ai(TOWER))];
    for encoder in &encoders {
        assert_eq!(encoder.fingerprint(), fingerprint);
    }
    for (Text { text, .. }, row) in texts.iter().zip(rows) {
        let expected = row.as_chunks::<4>().0.iter().map(|&x| f32::from_le_bytes(x));
        let [found, same] = [0, 1].map(|idx: usize| encoders[idx].encode(text));
        let max_error = found.iter().zip(expected).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
        assert!(max_error <= TOLERANCE, "{text:?}: {max_error}");
        assert_eq!(found, same, "{text:?}");
    }
}

#[test]
fn checkpoint_loads_only_the_encoder_it_names() {
    let fingerprint = encoder(&hugging_face(MIN_TOWER)).fingerprint();
    let folder = checkpoint(fingerprint.0, |_| {});
    check(&spec(&folder), &ROBOTS, QueryOptions::default()).unwrap();
    let mut policy = load(&spec(&folder), 1, QueryMode::Chunk, &Morphology::ALL).unwrap();
    let answer = ObservationBatch::of(Morphology::Single, &[0]).answer(&mut *policy);

    let other = checkpoint(fingerprint.0 ^ 1, |_| {});
    check(&spec(&other), &ROBOTS, QueryOptions::default()).unwrap();
    let error = load(&spec(&other), 1, QueryMode::Chunk, &Morphology::ALL).err().unwrap().to_string();
    let (path, expected) =
        (other.path().join("clip/model.safetensors"), WeightsFingerprint(fingerprint.0 ^ 1).to_string());
    for part in [path.to_str().unwrap(), "config.json", &fingerprint.to_string(), &expected] {
        assert!(error.contains(part), "`{error}` does not contain `{part}`");
    }

    let config = other.path().join("config.json");
    let text = fs::read_to_string(&config).unwrap();
    assert!(text.contains(r#""encoder": "clip-vit-b-32""#), "{text}");
    fs::write(&config, text.replace(&expected, &fingerprint.to_string())).unwrap();
    let mut policy = load(&spec(&other), 1, QueryMode::Chunk, &Morphology::ALL).unwrap();
    assert_eq!(ObservationBatch::of(Morphology::Single, &[0]).answer(&mut *policy)[0].rows, answer[0].rows);
    fs::write(&config, text.replace(&expected, "12345")).unwrap();
    assert_rejected(&other, &["config.json", "fingerprint `12345`", "16 hexadecimal digits"]);
}

#[test]
fn missing_encoder_folder_is_rejected_by_name() {
    let folder = checkpoint(0, |_| {});
    fs::remove_dir_all(folder.path().join("clip")).unwrap();
    assert_rejected(&folder, &["clip/model.safetensors", "No such file"]);
}

#[test]
fn missing_and_misshapen_tensors_are_rejected() {
    let folder = checkpoint(0, |list| list.retain(|(name, ..)| !name.ends_with("v_proj.bias")));
    assert_rejected(
        &folder,
        &["clip/model.safetensors", "layers.0.self_attn.v_proj.bias` is missing", "F32 [64]"],
    );
    let folder = checkpoint(0, |list| list.retain(|(name, ..)| !name.contains("token_embedding")));
    assert_rejected(&folder, &["token_embedding.weight` is missing", "Hugging Face's names or OpenAI's"]);
    let folder = checkpoint(0, |list| {
        list[0].1[0] -= 1;
        list[0].2.truncate(49407 * 64);
    });
    assert_rejected(
        &folder,
        &["token_embedding.weight` is F32 [49407, 64]", "F32 [49408, a multiple of 64]"],
    );
    let folder = checkpoint(0, |list| *list = hugging_face(TowerShape { dim: 64, ..MIN_TOWER }));
    assert_rejected(&folder, &["`text_projection.weight` is F32 [64, 64], expected F32 [512, 64]"]);
    let folder = checkpoint(0, |list| *list = open_ai(TowerShape { dim: 64, ..MIN_TOWER }));
    assert_rejected(&folder, &["`text_projection` is F32 [64, 64], expected F32 [64, 512]"]);
}

#[test]
fn network_with_other_embedding_dimension_is_rejected() {
    let folder = checkpoint(0, |_| {});
    write_checkpoint(folder.path(), &ActConfig::tiny(Morphology::Single), 0).unwrap();
    let config = folder.path().join("config.json");
    let mut value: serde_json::Value = serde_json::from_slice(&fs::read(&config).unwrap()).unwrap();
    value["language"] = serde_json::json!({ "encoder": "clip-vit-b-32", "fingerprint": "0123456789abcdef" });
    fs::write(&config, value.to_string()).unwrap();
    assert_rejected(&folder, &["`lang_proj.0.weight` is F32 [64, 64], expected F32 [512, 512]"]);
}
