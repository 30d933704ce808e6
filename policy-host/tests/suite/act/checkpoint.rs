//! Invalid checkpoints are rejected with a specific error before a run starts.

use std::fs;
use std::path::Path;

use ipc_types::{ControlMode, Morphology};
use policy_host::models::Family;
use policy_host::models::act::checkpoint::colosseum::ActConfig;
use policy_host::models::synthetic::write_checkpoint;
use policy_host::nn::Precision;
use policy_host::{ActionChunk, PolicyError, PolicySpec, QueryMode, check, load};
use run_config::{QueryOptions, error_chain};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use tempfile::TempDir;

use crate::batch::ObservationBatch;
use crate::{act_spec, assert_contains, data};

/// Writes a tiny checkpoint for the single-arm robot, for tests to modify.
fn checkpoint() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_checkpoint(folder.path(), &ActConfig::tiny(Morphology::Single), 3).unwrap();
    folder
}

/// The single-arm robot in its default control mode.
const SINGLE: (Morphology, ControlMode) = (Morphology::Single, ControlMode::EeDeltaPose);
/// Both robots in their default control modes.
const BOTH: [(Morphology, ControlMode); 2] = [SINGLE, (Morphology::Bimanual, ControlMode::JointPos)];

fn spec(folder: &Path) -> PolicySpec {
    act_spec(folder.to_owned())
}

/// Returns the error of `check` and `load`, which must be the same.
fn rejection(folder: &Path) -> String {
    let checked = error_chain(&check(&spec(folder), &[SINGLE], QueryOptions::default()).unwrap_err());
    let loaded = error_chain(&load(&spec(folder), 1, QueryMode::Chunk, &Morphology::ALL).err().unwrap());
    assert_eq!(checked, loaded, "check and load must agree");
    checked
}

/// Name, dtype, shape and bytes of a tensor.
type RawTensor = (String, Dtype, Vec<usize>, Vec<u8>);

/// Rewrites the weights file after applying `edit` to its tensors.
fn edit_tensors(folder: &Path, edit: impl FnOnce(&mut Vec<RawTensor>)) {
    let path = folder.join("model.safetensors");
    let bytes = fs::read(&path).unwrap();
    let tensors = SafeTensors::deserialize(&bytes).unwrap();
    let mut list: Vec<_> = tensors
        .iter()
        .map(|(name, tensor)| {
            (name.to_owned(), tensor.dtype(), tensor.shape().to_vec(), tensor.data().to_vec())
        })
        .collect();
    edit(&mut list);
    let views = list
        .iter()
        .map(|(name, dtype, shape, bytes)| (name, TensorView::new(*dtype, shape.clone(), bytes).unwrap()));
    fs::write(&path, safetensors::serialize(views, None).unwrap()).unwrap();
}

/// Rewrites the configuration after replacing one substring.
fn edit_config(folder: &Path, from: &str, to: &str) {
    let path = folder.join("config.json");
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains(from), "{text}");
    fs::write(path, text.replace(from, to)).unwrap();
}

#[test]
fn checkpoint_loads_with_and_without_unused_tensors() {
    let folder = checkpoint();
    check(&spec(folder.path()), &[SINGLE], QueryOptions::default()).unwrap();
    let before = ObservationBatch::of(Morphology::Single, &[0])
        .answer(&mut *load(&spec(folder.path()), 1, QueryMode::Chunk, &Morphology::ALL).unwrap());
    edit_tensors(folder.path(), |list| {
        list.push(("cls_embed.weight".to_owned(), Dtype::F32, vec![1, 64], vec![0; 256]));
        list.push(("latent_proj.bias".to_owned(), Dtype::F32, vec![64], vec![0; 256]));
        list.push(("backbones.0.0.body.bn1.num_batches_tracked".to_owned(), Dtype::I64, vec![], vec![0; 8]));
    });
    let after = ObservationBatch::of(Morphology::Single, &[0])
        .answer(&mut *load(&spec(folder.path()), 1, QueryMode::Chunk, &Morphology::ALL).unwrap());
    assert_eq!(before[0].rows, after[0].rows);
}

#[test]
fn missing_tensor_error_states_name_and_shape() {
    let folder = checkpoint();
    edit_tensors(folder.path(), |list| list.retain(|(name, ..)| name != "action_head.weight"));
    let path = folder.path().join("model.safetensors").display().to_string();
    assert_contains(&rejection(folder.path()), &[&path, "`action_head.weight` is missing", "F32 [7, 64]"]);
}

#[test]
fn unknown_tensor_is_rejected_by_name() {
    let folder = checkpoint();
    edit_tensors(folder.path(), |list| list.push(("head.extra".to_owned(), Dtype::F32, vec![2], vec![0; 8])));
    assert_contains(&rejection(folder.path()), &["`head.extra`", "F32 [2]", "is not part of the network"]);
}

#[test]
fn tensors_of_wrong_shape_or_dtype_are_rejected() {
    let folder = checkpoint();
    edit_tensors(folder.path(), |list| {
        let tensor = list.iter_mut().find(|(name, ..)| name == "input_proj_robot_state.weight").unwrap();
        tensor.2 = vec![25, 64];
    });
    assert_contains(
        &rejection(folder.path()),
        &["`input_proj_robot_state.weight` is F32 [25, 64], expected F32 [64, 25]"],
    );

    let folder = checkpoint();
    edit_tensors(folder.path(), |list| {
        let tensor = list.iter_mut().find(|(name, ..)| name == "query_embed.weight").unwrap();
        (tensor.1, tensor.3) = (Dtype::I16, vec![0; 30 * 64 * 2]);
    });
    assert_contains(
        &rejection(folder.path()),
        &["`query_embed.weight` is I16 [30, 64], expected F32 [30, 64]"],
    );
}

/// Sets one value of a tensor.
fn set_value(folder: &Path, name: &str, value: f32) {
    edit_tensors(folder, |list| {
        let tensor = list.iter_mut().find(|(found, ..)| found == name).unwrap();
        tensor.3[..4].copy_from_slice(&value.to_le_bytes());
    });
}

#[test]
fn weights_that_are_no_numbers_are_rejected() {
    let variance = "backbones.0.0.body.layer2.0.bn1.running_var";
    for (name, value, message) in [
        ("action_head.bias", f32::NAN, "not finite"),
        ("backbones.0.0.body.conv1.weight", f32::INFINITY, "not finite"),
        ("transformer.encoder.layers.1.linear1.weight", f32::NEG_INFINITY, "not finite"),
        (variance, f32::NAN, "not finite"),
        (variance, -0.5, "contains -0.5, expected variances of 0 or more"),
    ] {
        let folder = checkpoint();
        set_value(folder.path(), name, value);
        let path = folder.path().join("model.safetensors").display().to_string();
        assert_contains(&rejection(folder.path()), &[&path, &format!("`{name}`"), message]);
    }
}

/// A rectifier that takes NaN for 0 would turn the overflow into plausible actions.
#[test]
fn overflow_reaches_the_actions() {
    let folder = checkpoint();
    set_value(folder.path(), "backbones.0.0.body.bn1.weight", 3e38);
    for spec in
        [act_spec(folder.path().to_owned()), PolicySpec::network(Family::Act, Precision::Int8, folder.path())]
    {
        let answers = ObservationBatch::of(Morphology::Single, &[0])
            .answer(&mut *load(&spec, 1, QueryMode::Chunk, &Morphology::ALL).unwrap());
        assert!(answers[0].rows.iter().any(|x| !x.is_finite()), "{:?}", answers[0].rows);
    }
}

#[test]
fn incomplete_statistics_are_rejected() {
    let folder = checkpoint();
    edit_tensors(folder.path(), |list| {
        list.push(("norm_stats.state_mean".to_owned(), Dtype::F32, vec![25], vec![0; 100]));
    });
    assert_contains(&rejection(folder.path()), &["`norm_stats.state_std` is missing", "F32 [25]"]);
}

#[test]
fn truncated_and_corrupt_files_are_rejected() {
    let folder = checkpoint();
    let path = folder.path().join("model.safetensors");
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() - 1000]).unwrap();
    assert_contains(&rejection(folder.path()), &["model.safetensors", "truncated", &bytes.len().to_string()]);
    fs::write(&path, &bytes[..100]).unwrap();
    assert_contains(&rejection(folder.path()), &["not a safetensors file"]);
    fs::write(&path, &bytes[..4]).unwrap();
    assert_contains(&rejection(folder.path()), &["not a safetensors file", "4 bytes"]);
    fs::write(&path, "this is not a model, but it is long enough to be read as one").unwrap();
    assert_contains(&rejection(folder.path()), &["not a safetensors file"]);
    fs::remove_file(&path).unwrap();
    assert_contains(&rejection(folder.path()), &["model.safetensors", "No such file"]);
}

#[test]
fn invalid_configuration_errors_name_the_key() {
    for (from, to, parts) in [
        ("\"enc_layers\"", "\"encoder_layers\"", &["config.json", "unknown field `encoder_layers`"][..]),
        (
            "\"type\": \"act_colosseum\"",
            "\"type\": \"diffusion\"",
            &["`type` is `diffusion`", "act_colosseum"],
        ),
        ("\"dec_layers\": 1,", "", &["missing field `dec_layers`"]),
        (
            "\"pd_ee_delta_pose\"",
            "\"pd_joint_delta\"",
            &["unknown control_mode `pd_joint_delta`", "pd_joint_pos"],
        ),
        ("\"num_queries\": 30", "\"num_queries\": 6400", &["`num_queries` is 6400, expected 1 to 1024"]),
        ("\"state_dim\": 25", "\"state_dim\": 18", &["`state_dim` is 18, expected 25 (single"]),
        (
            "\"nheads\": 4",
            "\"nheads\": 5",
            &["`token width` is 64, expected a multiple of 4 and of the number of heads, 5"],
        ),
        ("\"morphology\": \"single\"", "\"morphology\": null", &["`morphology` is null"]),
        ("\"hashed\"", "\"clip\"", &["unknown variant `clip`", "hashed"]),
        ("{", "{{", &["config.json", "line 1"]),
    ] {
        let folder = checkpoint();
        edit_config(folder.path(), from, to);
        assert_contains(&rejection(folder.path()), parts);
    }
}

#[test]
fn checkpoint_for_another_robot_is_rejected() {
    let folder = checkpoint();
    let error = check(&spec(folder.path()), &BOTH, QueryOptions::default()).unwrap_err().to_string();
    assert_contains(&error, &["is for single", "run has bimanual tasks"]);
    check(&spec(&data("act-tiny")), &BOTH, QueryOptions::default()).unwrap();

    let config = ActConfig { control_mode: ControlMode::EePose, ..ActConfig::tiny(Morphology::Single) };
    write_checkpoint(folder.path(), &config, 0).unwrap();
    let error = check(&spec(folder.path()), &[SINGLE], QueryOptions::default()).unwrap_err().to_string();
    assert_contains(&error, &["single robot in pd_ee_pose", "run in pd_ee_delta_pose"]);
    check(&spec(folder.path()), &[(Morphology::Single, ControlMode::EePose)], QueryOptions::default())
        .unwrap();

    let empty = tempfile::tempdir().unwrap();
    let error = check(&spec(empty.path()), &[SINGLE], QueryOptions::default()).unwrap_err().to_string();
    assert_contains(&error, &["no checkpoint in", "`single` and `bimanual`", "config.json"]);
}

#[test]
fn observation_that_mismatches_the_checkpoint_is_rejected() {
    let folder = checkpoint();
    let mut policy = load(&spec(folder.path()), 1, QueryMode::Chunk, &Morphology::ALL).unwrap();
    let mut rejected = |batch: &ObservationBatch| -> PolicyError {
        policy.act(&batch.view(), &mut [ActionChunk::default()]).unwrap_err()
    };
    assert_eq!(
        rejected(&ObservationBatch::of(Morphology::Bimanual, &[0])),
        PolicyError::Morphology { found: "bimanual" }
    );
    let mut batch = ObservationBatch::of(Morphology::Single, &[0]);
    batch.header.control_mode = ControlMode::JointPos.code();
    assert!(matches!(rejected(&batch), PolicyError::ControlMode { .. }));
    let mut batch = ObservationBatch::of(Morphology::Single, &[0]);
    (batch.header.images, batch.header.block_pages) = (0, 1);
    batch.pages.truncate(1);
    assert_eq!(rejected(&batch), PolicyError::NoImages);
}
