//! LeRobot checkpoints against LeRobot's own outputs, recorded by `python/make_lerobot_reference.py`.

use std::path::Path;

use ipc_types::{ControlMode, ImageSize, Morphology, ObservationView};
use policy_host::models::act::checkpoint::ActCheckpoint;
use policy_host::models::act::image::Image;
use policy_host::models::act::model::{ActInput, ActModel};
use policy_host::policy::ensemble::Ensemble;
use policy_host::{ActionChunk, Policy, PolicyError, QueryMode, check, load};
use run_config::{QueryOptions, error_chain};
use safetensors::SafeTensors;

use crate::batch::ObservationBatch;
use crate::{act_spec, assert_contains, data, rows};

/// Maximum absolute difference of an action entry.
const TOLERANCE: f32 = 1e-4;

/// Recorded inputs and outputs of a case.
struct ReferenceIo {
    bytes: Vec<u8>,
}

impl ReferenceIo {
    fn of(case: &str) -> Self {
        Self { bytes: std::fs::read(data("lerobot").join(case).join("io.safetensors")).unwrap() }
    }

    fn tensors(&self) -> SafeTensors<'_> {
        SafeTensors::deserialize(&self.bytes).unwrap()
    }

    /// Returns the values and the shape of a tensor.
    fn values(&self, name: &str) -> (Vec<f32>, Vec<usize>) {
        let tensors = self.tensors();
        let tensor = tensors.tensor(name).unwrap();
        let values = tensor.data().as_chunks::<4>().0.iter().map(|&x| f32::from_le_bytes(x)).collect();
        (values, tensor.shape().to_vec())
    }

    /// Returns the images of a camera, converted from `[n, 3, h, w]` to `[h, w, 3]` each.
    fn images(&self, name: &str) -> Vec<(Vec<u8>, ImageSize)> {
        let tensors = self.tensors();
        let tensor = tensors.tensor(name).unwrap();
        let &[_, 3, height, width] = tensor.shape() else { panic!("{name}: {:?}", tensor.shape()) };
        let n_pixels = height * width;
        let image = |planes: &[u8]| {
            (0..3 * n_pixels).map(|idx| planes[idx % 3 * n_pixels + idx / 3]).collect::<Vec<u8>>()
        };
        let images = tensor.data().chunks_exact(3 * n_pixels);
        images.map(|planes| (image(planes), ImageSize { height, width })).collect()
    }
}

fn max_error(found: &[f32], expected: &[f32]) -> f32 {
    assert_eq!(found.len(), expected.len());
    found.iter().zip(expected).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max)
}

/// Runs the network of a case on its recorded inputs, with one thread and with a team of two. Compares the
/// chunks with the recorded ones.
fn assert_parity(case: &str, cameras: &[&str]) {
    let folder = data("lerobot").join(case);
    let recording = ReferenceIo::of(case);
    let images: Vec<_> =
        cameras.iter().map(|name| recording.images(&format!("observation.images.{name}"))).collect();
    let sizes: Vec<ImageSize> = images.iter().map(|images| images[0].1).collect();
    let model = ActModel::load(&folder, &sizes).unwrap();
    let architecture = model.architecture().clone();
    let (states, shape) = recording.values("observation.state");
    let environment = architecture.instruction.map(|_| recording.values("observation.environment_state").0);
    let (chunks, _) = recording.values("chunk");
    for n_members in [1, 2] {
        let mut scratch = model.scratch(shape[0], n_members);
        model.encode_images(
            shape[0],
            |sample, camera| {
                let (pixels, size) = &images[camera][sample];
                Image { pixels, size: *size }
            },
            &mut scratch,
        );
        let mut found = Vec::new();
        for (sample, state) in states.chunks_exact(shape[1]).enumerate() {
            let token = environment.as_ref().map(|environment| {
                let width = environment.len() / shape[0];
                model.instruction_token(&environment[sample * width..][..width]).unwrap()
            });
            let mut actions = vec![0.0; architecture.horizon * architecture.action_dim];
            let input = ActInput { state, instruction_token: token.as_deref() };
            model.forward(sample, input, &mut scratch, &mut actions);
            found.extend(actions);
        }
        let max_error = max_error(&found, &chunks);
        assert!(max_error <= TOLERANCE, "{case}, {n_members} threads: {max_error}");
    }
}

#[test]
fn networks_agree_with_lerobot() {
    assert_parity("env_state", &[]);
    assert_parity("cameras", &["top", "wrist"]);
    assert_parity("older", &["top", "wrist"]);
    assert_parity("robot", &["external1", "external2", "hand"]);
}

#[test]
fn policy_agrees_with_lerobot_end_to_end() {
    let mut policy = load(&act_spec(data("lerobot/robot")), 2, QueryMode::Chunk, &Morphology::ALL).unwrap();
    assert_actions_agree(&mut *policy);
}

/// Compares the actions of the case `robot` with the recorded ones.
pub(crate) fn assert_actions_agree(policy: &mut dyn Policy) {
    let answer = ObservationBatch::of(Morphology::Single, &[0, 1]).executing(63).answer(policy);
    let (actions, shape) = ReferenceIo::of("robot").values("actions");
    assert_eq!(shape, [2, 70, 7]);
    for (block, actions) in answer.iter().zip(actions.chunks_exact(70 * 7)) {
        // A message holds 63 rows.
        assert_eq!((block.n_rows, block.action_dim), (63, 7));
        let max_error = max_error(rows(block), &actions[..63 * 7]);
        assert!(max_error <= TOLERANCE, "{max_error}");
    }
}

/// A policy that replays recorded chunks `[n_steps, horizon, action_dim]`.
struct RecordedPolicy {
    chunks: Vec<f32>,
    horizon: usize,
    action_dim: usize,
    decay: f64,
}

impl Policy for RecordedPolicy {
    fn act(
        &mut self,
        observation: &ObservationView<'_>,
        answer: &mut [ActionChunk],
    ) -> Result<(), PolicyError> {
        let len = self.horizon * self.action_dim;
        for (env_idx, chunk) in answer.iter_mut().enumerate() {
            let step = observation.env(env_idx).record.query as usize;
            let rows = &self.chunks[step * len..][..len];
            chunk.reset(self.horizon, self.action_dim).copy_from_slice(rows);
        }
        Ok(())
    }

    fn ensemble_decay(&self, _: Morphology) -> f64 {
        self.decay
    }
}

#[test]
fn temporal_ensembling_agrees_with_lerobot() {
    let recording = ReferenceIo::of("robot");
    let (chunks, shape) = recording.values("episode_chunks");
    let (actions, _) = recording.values("episode_actions");
    let [n_steps, horizon, action_dim] = shape[..] else { panic!("{shape:?}") };
    assert!(n_steps > horizon, "the episode must outlast the horizon");
    let decay = ActCheckpoint::open(&data("lerobot/robot")).unwrap().chunk_settings().ensemble_decay.unwrap();
    let mut policy = Ensemble::new(Box::new(RecordedPolicy { chunks, horizon, action_dim, decay }));
    for (step, expected) in actions.chunks_exact(action_dim).enumerate() {
        let mut batch = ObservationBatch::of(Morphology::Single, &[0]);
        bytemuck::cast_mut::<_, ipc_types::EnvRecord>(&mut batch.pages[0]).query = step as u32;
        let answer = batch.answer(&mut policy);
        let max_error = max_error(rows(&answer[0]), expected);
        assert!(max_error <= 1e-5, "step {step}: {max_error}");
    }
}

/// Copies a case to a temporary folder, for tests to modify.
fn copy(case: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for entry in std::fs::read_dir(data("lerobot").join(case)).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, folder.path().join(path.file_name().unwrap())).unwrap();
    }
    folder
}

fn edit(path: &Path, from: &str, to: &str) {
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.contains(from), "{text}");
    std::fs::write(path, text.replace(from, to)).unwrap();
}

/// Returns the error of `check`, with its causes.
fn rejection(folder: &Path) -> String {
    let spec = act_spec(folder.to_owned());
    error_chain(
        &check(&spec, &[(Morphology::Single, ControlMode::EeDeltaPose)], QueryOptions::default())
            .unwrap_err(),
    )
}

#[test]
fn unsupported_option_errors_list_supported_values() {
    for (file, from, to, says) in [
        (
            "config.json",
            "\"pre_norm\": false",
            "\"pre_norm\": true",
            &["`pre_norm` is true, expected false"][..],
        ),
        ("config.json", "\"resnet18\"", "\"resnet50\"", &["`vision_backbone` is `resnet50`", "resnet34"]),
        ("config.json", "\"relu\"", "\"gelu\"", &["`feedforward_activation` is `gelu`, expected relu"]),
        ("config.json", "\"type\": \"act\"", "\"type\": \"diffusion\"", &["`type` is `diffusion`"]),
        ("config.json", "\"chunk_size\": 70,", "", &["model.safetensors", "[100, 32]"]),
        (
            "config.json",
            "\"n_action_steps\": 1,",
            "\"n_action_steps\": 71,",
            &["`n_action_steps` is 71", "which is 70"],
        ),
        (
            "config.json",
            "\"pre_norm\"",
            "\"pre_norms\"",
            &["unknown setting `pre_norms` (false)", "`ignore`"],
        ),
        ("config.json", "\"MEAN_STD\"", "\"MEDIAN\"", &["config.json", "unknown variant `MEDIAN`"]),
        (
            "policy_preprocessor.json",
            "\"to_batch_processor\"",
            "\"delta_action_processor\"",
            &["policy_preprocessor.json", "`steps[1]` is `delta_action_processor`"],
        ),
        (
            "policy_preprocessor.json",
            "step_3_normalizer_processor.safetensors",
            "step_9.safetensors",
            &["step_9.safetensors", "No such file"],
        ),
        (
            "config.json",
            "\"dim_model\": 32",
            "\"dim_model\": 64",
            &["model.safetensors", "is F32", "expected F32"],
        ),
    ] {
        let folder = copy("robot");
        edit(&folder.path().join(file), from, to);
        assert_contains(&rejection(folder.path()), says);
    }
}

#[test]
fn unmapped_feature_errors_list_both_sides() {
    let both_sides = ["observation.state [25]", "external2_camera", "tcp_pose 7", "hypogeum.json"];
    for (config, mapping, says) in [
        (("images.hand", "images.front"), "", "no camera matches `observation.images.front`"),
        (
            ("", ""),
            "\"mapping\": {\"observation.images.hand\": \"nose\"}",
            "mapped to `nose`, which is not a camera",
        ),
        (("", ""), "\"mapping\": {\"observation.state\": [\"qpos\"]}", "has 25 entries, its mapping has 9"),
        (
            ("", ""),
            "\"mapping\": {\"observation.state\": \"joints\"}",
            "`joints`, which is not part of the state",
        ),
        (
            ("", ""),
            "\"mapping\": {\"observation.images.rear\": \"hand\"}",
            "`observation.images.rear`, which is not an input",
        ),
    ] {
        let folder = copy("robot");
        if !config.0.is_empty() {
            for file in ["config.json", "policy_preprocessor.json"] {
                edit(&folder.path().join(file), config.0, config.1);
            }
            let preprocessor = folder.path().join("policy_preprocessor.json");
            edit(&preprocessor, "\"VISUAL\": \"MEAN_STD\"", "\"VISUAL\": \"IDENTITY\"");
        }
        if !mapping.is_empty() {
            edit(&folder.path().join("hypogeum.json"), "\"language\"", &format!("{mapping}, \"language\""));
        }
        let error = rejection(folder.path());
        assert_contains(&error, &[says]);
        assert_contains(&error, &both_sides);
    }
    let folder = copy("robot");
    std::fs::remove_file(folder.path().join("hypogeum.json")).unwrap();
    assert_contains(
        &rejection(folder.path()),
        &["`observation.environment_state`", "no `language` encoder is given"],
    );
    let folder = copy("cameras");
    assert_contains(&rejection(folder.path()), &["actions have 6 entries", "single pd_joint_pos 8"]);
}

#[test]
fn mapping_can_swap_cameras_and_select_state_parts() {
    let folder = copy("robot");
    let swap = "\"mapping\": {\"observation.images.external1\": \"external2_camera\", \
                \"observation.images.external2\": \"external1\", \
                \"observation.state\": [\"qvel\", \"qpos\", \"tcp_pose\"]}, \"language\"";
    edit(&folder.path().join("hypogeum.json"), "\"language\"", swap);
    let mapping = ActCheckpoint::open(folder.path()).unwrap().mapping().unwrap().clone();
    assert_eq!((mapping.cameras, mapping.state), (vec![1, 0, 2], vec![9..18, 0..9, 18..25]));
    let json = folder.path().join("hypogeum.json");
    edit(&json, "\"qvel\", \"qpos\"", "\"qvel[1:9]\", \"qpos[0:9]\", \"qvel[0:1]\"");
    let mapping = ActCheckpoint::open(folder.path()).unwrap().mapping().unwrap().clone();
    assert_eq!(mapping.state, [10..18, 0..9, 9..10, 18..25]);
    edit(&json, "qvel[1:9]", "qvel[1:10]");
    assert_contains(&rejection(folder.path()), &["`qvel[1:10]`", "no slice of its 9 entries"]);
}

#[test]
fn older_checkpoint_without_statistics_is_rejected() {
    let folder = copy("cameras");
    for file in ["policy_preprocessor.json", "policy_postprocessor.json"] {
        std::fs::remove_file(folder.path().join(file)).unwrap();
    }
    let error = ActCheckpoint::open(folder.path()).unwrap_err().to_string();
    assert_contains(
        &error,
        &["statistics of `observation.state` are missing", "neither policy_preprocessor.json nor"],
    );
}
