//! π0.5 checkpoints against LeRobot's own outputs, recorded by `python/make_pi05_reference.py`.

mod errors;
#[cfg(feature = "gpu")]
mod gpu;
mod vocabulary;

use std::path::{Path, PathBuf};

use ipc_types::Morphology;
use policy_host::formats::mapping::PromptState;
use policy_host::models::pi05::checkpoint::{Pi05Checkpoint, Pi05Description};
use policy_host::models::pi05::image::{BLACK, resize_with_pad};
use policy_host::models::pi05::model::{Pi05Input, Pi05Trace, SampleTokens};
use policy_host::models::pi05::processor::prompt;
use policy_host::nn::Precision;
use policy_host::{PolicySpec, QueryMode, load};
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView};
use serde_json::Value;
use tempfile::TempDir;

use crate::batch::ObservationBatch;
use crate::data;

/// Maximum absolute difference of any value of any stage.
const TOLERANCE: f32 = 1e-4;

/// A case: its recorded results and the folder of its checkpoint.
struct Case {
    folder: PathBuf,
    bytes: Vec<u8>,
    instructions: Vec<String>,
}

impl Case {
    /// Reads the results of a case, whose checkpoint is in `folder`.
    fn with_checkpoint(name: &str, folder: &Path) -> Self {
        let recorded = data("pi05").join(name);
        let texts: Value = serde_json::from_slice(&std::fs::read(recorded.join("io.json")).unwrap()).unwrap();
        let instructions = texts["instructions"].as_array().unwrap();
        Self {
            folder: folder.to_owned(),
            bytes: std::fs::read(recorded.join("io.safetensors")).unwrap(),
            instructions: instructions.iter().map(|text| text.as_str().unwrap().to_owned()).collect(),
        }
    }

    fn of(name: &str) -> Self {
        Self::with_checkpoint(name, &data("pi05").join(name))
    }

    fn tensors(&self) -> SafeTensors<'_> {
        SafeTensors::deserialize(&self.bytes).unwrap()
    }

    fn values(&self, name: &str) -> Vec<f32> {
        let tensors = self.tensors();
        let tensor = tensors.tensor(name).unwrap();
        assert_eq!(tensor.dtype(), Dtype::F32, "{name}");
        tensor.data().as_chunks::<4>().0.iter().map(|&x| f32::from_le_bytes(x)).collect()
    }

    /// Returns the tokens of each sample without padding.
    fn tokens(&self) -> Vec<Vec<u32>> {
        let tensors = self.tensors();
        let (tokens, mask) = (tensors.tensor("tokens").unwrap(), tensors.tensor("token_mask").unwrap());
        let width = tokens.shape()[1];
        let tokens = tokens.data().as_chunks::<4>().0.iter().map(|&x| u32::from_le_bytes(x));
        let tokens: Vec<u32> = tokens.collect();
        let rows = tokens.chunks_exact(width).zip(mask.data().chunks_exact(width));
        rows.map(|(row, mask)| {
            row.iter().zip(mask).filter(|(_, kept)| **kept == 1).map(|(x, _)| *x).collect()
        })
        .collect()
    }

    /// Returns the recorded images of a camera, as `[h, w, 3]` with their sizes.
    fn images(&self, camera: &str) -> Vec<(Vec<u8>, [usize; 2])> {
        let tensors = self.tensors();
        let tensor = tensors.tensor(&format!("in.observation.images.{camera}")).unwrap();
        let &[_, 3, height, width] = tensor.shape() else { panic!("{camera}: {:?}", tensor.shape()) };
        let n_pixels = height * width;
        let image =
            |planes: &[u8]| (0..3 * n_pixels).map(|idx| planes[idx % 3 * n_pixels + idx / 3]).collect();
        tensor.data().chunks_exact(3 * n_pixels).map(|planes| (image(planes), [height, width])).collect()
    }
}

fn max_error(found: &[f32], expected: &[f32]) -> f32 {
    assert_eq!(found.len(), expected.len(), "number of values");
    found.iter().zip(expected).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max)
}

/// Images and states of all samples of a case: recorded, or generated observations of the robot.
struct Inputs {
    /// Images of each sample, in the network's order.
    images: Vec<Vec<(Vec<u8>, [usize; 2])>>,
    /// State of each sample, as the network takes it.
    states: Vec<Vec<f32>>,
}

fn recorded_inputs(case: &Case, cameras: &[&str]) -> Inputs {
    let by_camera: Vec<_> = cameras.iter().map(|camera| case.images(camera)).collect();
    let states = case.values("in.observation.state");
    let n = case.instructions.len();
    Inputs {
        images: (0..n).map(|idx| by_camera.iter().map(|images| images[idx].clone()).collect()).collect(),
        states: states.chunks_exact(states.len() / n).map(<[f32]>::to_vec).collect(),
    }
}

fn generated_inputs(checkpoint: &Pi05Checkpoint, n: usize) -> Inputs {
    let mapping = &checkpoint.description().mapping;
    let batch = ObservationBatch::of(Morphology::Single, &(0..n as u32).collect::<Vec<_>>());
    let view = batch.view();
    let image = |env: usize, camera: usize| {
        let (pixels, size) = view.env(env).image(camera);
        (pixels.to_vec(), [size.height, size.width])
    };
    Inputs {
        images: (0..n)
            .map(|env| mapping.cameras.iter().map(|&camera| image(env, camera)).collect())
            .collect(),
        states: (0..n)
            .map(|env| {
                let state = view.env(env).state;
                mapping.state.iter().flat_map(|part| &state[part.clone()]).copied().collect()
            })
            .collect(),
    }
}

/// StageResults of every stage.
struct StageResults {
    tokens: Vec<Vec<u32>>,
    pixels: Vec<f32>,
    trace: Pi05Trace,
    /// Actions in the network's scale and width.
    padded: Vec<f32>,
    /// Actions of the robot.
    actions: Vec<f32>,
}

/// Inputs of the network, and what describes its outputs.
struct PreparedBatch {
    description: Pi05Description,
    pixels: Vec<f32>,
    samples: Vec<SampleTokens>,
    /// Noise `[n, horizon, action_width]`.
    noise: Vec<f32>,
}

/// Prepares samples `range` of a case.
fn prepare(
    checkpoint: &Pi05Checkpoint,
    case: &Case,
    cameras: Option<&[&str]>,
    range: std::ops::Range<usize>,
) -> PreparedBatch {
    let (description, tokenizer) = (checkpoint.description(), checkpoint.tokenizer().unwrap());
    let side = description.architecture.image_side();
    let inputs = match cameras {
        Some(cameras) => recorded_inputs(case, cameras),
        None => generated_inputs(checkpoint, case.instructions.len()),
    };
    let (mut pixels, mut samples) = (Vec::new(), Vec::new());
    for sample in range.clone() {
        let mut indices = Vec::new();
        for (image, size) in &inputs.images[sample] {
            let mut planes = vec![0.0; 3 * side * side];
            resize_with_pad(image, *size, side, BLACK, &mut planes);
            indices.push(pixels.len() / planes.len());
            pixels.extend(planes);
        }
        let mut state = inputs.states[sample].clone();
        description.state.normalise(&mut state);
        if description.prompt_state == PromptState::Padded {
            state.resize(description.max_state_dim, 0.0);
        }
        let prompt = tokenizer.tokens(&prompt(&case.instructions[sample], &state)).unwrap();
        samples.push(SampleTokens { images: indices, prompt });
    }
    let noise = case.values("noise");
    let len = noise.len() / case.instructions.len();
    let noise = noise[range.start * len..range.end * len].to_vec();
    PreparedBatch { description: description.clone(), pixels, samples, noise }
}

impl PreparedBatch {
    /// Returns the robot's actions for the network's.
    fn actions(&self, padded: &[f32]) -> Vec<f32> {
        let Pi05Description { architecture, action, action_dim, .. } = &self.description;
        let mut actions = Vec::new();
        for row in padded.chunks_exact(architecture.action_width) {
            let mut row = row[..*action_dim].to_vec();
            action.restore(&mut row);
            actions.extend(row);
        }
        actions
    }
}

/// Runs the network on samples `range` of a case, as one batch.
fn run(
    case: &Case,
    cameras: Option<&[&str]>,
    precision: Precision,
    range: std::ops::Range<usize>,
) -> StageResults {
    let checkpoint = Pi05Checkpoint::open(&case.folder).unwrap();
    let model = checkpoint.load(precision, checkpoint.description().n_steps).unwrap();
    let batch = prepare(&checkpoint, case, cameras, range);
    let mut padded = batch.noise.clone();
    let mut trace = Pi05Trace::default();
    let input = Pi05Input { images: &batch.pixels, samples: &batch.samples };
    model.sample(input, &mut padded, Some(&mut trace));
    let actions = batch.actions(&padded);
    let tokens = batch.samples.into_iter().map(|sample| sample.prompt).collect();
    StageResults { tokens, pixels: batch.pixels, trace, padded, actions }
}

/// Compares every stage of a case with the recording.
fn assert_parity(case: &Case, cameras: Option<&[&str]>) {
    let n = case.instructions.len();
    let found = run(case, cameras, Precision::F32, 0..n);
    assert_eq!(found.tokens, case.tokens(), "tokens");
    let first = |values: &[f32], name: &str| {
        let expected = case.values(name);
        let error = max_error(&values[..expected.len()], &expected);
        assert!(error <= TOLERANCE, "{name} differ by {error}");
    };
    first(&found.pixels, "pixels");
    first(&found.trace.image_embeddings, "image_embeddings");
    first(&found.trace.prefix, "prefix");
    first(&found.trace.velocities[0], "velocity_0");
    first(&found.trace.velocities[9], "velocity_9");
    first(&found.padded, "actions32");
    first(&found.actions, "actions");
    // One sample at a time gives the same bits.
    let alone = (0..n).flat_map(|sample| run(case, cameras, Precision::F32, sample..sample + 1).padded);
    assert!(alone.map(f32::to_bits).eq(found.padded.iter().map(|x| x.to_bits())), "batch");
}

#[test]
fn robot_with_three_cameras_matches_lerobot() {
    assert_parity(&Case::of("robot"), None);
}

#[test]
fn one_camera_matches_lerobot() {
    assert_parity(&Case::of("one_camera"), Some(&["hand"]));
}

#[test]
fn missing_camera_matches_lerobot() {
    assert_parity(&Case::of("missing"), Some(&["base_0_rgb", "left_wrist_0_rgb"]));
}

#[test]
fn older_prompt_with_padded_state_matches_lerobot() {
    let folder = copy_of("one_camera");
    overlay(&data("pi05/padded"), folder.path());
    assert_parity(&Case::with_checkpoint("padded", folder.path()), Some(&["hand"]));
}

/// The actions of the same weights in LeRobot's own bfloat16 and in our int8 differ from f32 by similar
/// amounts.
#[test]
fn bfloat16_shards_match_lerobot() {
    let case = Case::of("bf16");
    assert_parity(&case, None);
    let exact = case.values("actions32");
    let theirs = max_error(&case.values("bf16.actions32"), &exact);
    let int8 = run(&case, None, Precision::Int8, 0..case.instructions.len());
    let ours = max_error(&int8.padded, &exact);
    assert!((1e-4..0.05).contains(&theirs), "bfloat16 differs by {theirs}");
    assert!((1e-4..0.1).contains(&ours), "int8 differs by {ours}");
}

/// openpi's folder with the weights of `one_camera` gives its actions, but for the term that openpi adds to
/// the width of a range.
#[test]
fn openpi_folder_gives_lerobots_actions() {
    let folder = TempDir::new().unwrap();
    overlay(&data("pi05/openpi"), folder.path());
    std::fs::copy(data("pi05/one_camera/tokenizer.model"), folder.path().join("tokenizer.model")).unwrap();
    rewrite(
        &data("pi05/one_camera/model.safetensors"),
        &folder.path().join("model.safetensors"),
        |name, view| {
            Some((name.strip_prefix("model.")?.to_owned(), view.shape().to_vec(), view.data().to_vec()))
        },
    );
    let case = Case::with_checkpoint("one_camera", folder.path());
    let found = run(&case, Some(&["hand"]), Precision::F32, 0..2);
    assert_eq!(found.tokens, case.tokens());
    assert!(max_error(&found.actions, &case.values("actions")) <= TOLERANCE);
}

#[test]
fn steps_and_seed_change_the_actions() {
    let folder = data("pi05/robot");
    let answer = |spec: &str, query: u32| {
        let spec: PolicySpec = spec.parse().unwrap();
        let mut policy = load(&spec, 1, QueryMode::Chunk, &Morphology::ALL).unwrap();
        let mut batch = ObservationBatch::of(Morphology::Single, &[0]);
        let record: &mut ipc_types::EnvRecord = bytemuck::cast_mut(&mut batch.pages[0]);
        record.query = query;
        batch.answer(&mut *policy)[0].rows
    };
    let own = answer(&format!("pi05:{}", folder.display()), 0);
    assert_eq!(own, answer(&format!("pi05:{}?steps=10", folder.display()), 0));
    assert_ne!(own, answer(&format!("pi05:{}?steps=5", folder.display()), 0));
    assert_ne!(own, answer(&format!("pi05:{}", folder.display()), 1), "another query has other noise");
}

#[test]
fn actions_do_not_depend_on_batch_or_threads() {
    let bits =
        |block: &ipc_types::ActionBlock| crate::rows(block).iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    for kind in ["pi05", "pi05-int8"] {
        let spec: PolicySpec = format!("{kind}:{}", data("pi05/robot").display()).parse().unwrap();
        let mut policy = load(&spec, 1, QueryMode::Chunk, &Morphology::ALL).unwrap();
        let mut answer = |envs: &[u32]| ObservationBatch::of(Morphology::Single, envs).answer(&mut *policy);
        let alone: Vec<_> = (0..20).map(|env| bits(&answer(&[env])[0])).collect();
        assert_ne!(alone[0], alone[1], "different observations must give different actions");
        // Several times the same env, as at the start of an episode under a perturbation of the language.
        let batches: [Vec<u32>; 4] =
            [vec![3, 1], vec![2, 2, 5, 2], (0..9).rev().collect(), (0..20).collect()];
        for n_threads in [1, 2, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            for envs in &batches {
                let answer =
                    pool.install(|| ObservationBatch::of(Morphology::Single, envs).answer(&mut *policy));
                for (&env, block) in envs.iter().zip(&answer) {
                    let place = format!("{kind}, env {env} in {envs:?}, {n_threads} threads");
                    assert_eq!(bits(block), alone[env as usize], "{place}");
                }
            }
        }
    }
}

/// Copies a checkpoint to a temporary folder.
fn copy_of(case: &str) -> TempDir {
    let folder = TempDir::new().unwrap();
    overlay(&data("pi05").join(case), folder.path());
    folder
}

/// Copies all files of a folder.
fn overlay(from: &Path, to: &Path) {
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() {
            std::fs::create_dir_all(&target).unwrap();
            overlay(&path, &target);
        } else {
            std::fs::copy(&path, target).unwrap();
        }
    }
}

/// Name, shape and bytes of a tensor.
type Rewritten = (String, Vec<usize>, Vec<u8>);

/// Writes a weights file whose tensors are those of another, changed or left out by `change`.
fn rewrite(from: &Path, to: &Path, change: impl Fn(&str, &TensorView<'_>) -> Option<Rewritten>) {
    let bytes = std::fs::read(from).unwrap();
    let tensors = SafeTensors::deserialize(&bytes).unwrap();
    let changed: Vec<(Rewritten, Dtype)> = tensors
        .tensors()
        .iter()
        .filter_map(|(name, view)| change(name, view).map(|changed| (changed, view.dtype())))
        .collect();
    let views = changed.iter().map(|((name, shape, bytes), dtype)| {
        (name.as_str(), TensorView::new(*dtype, shape.clone(), bytes).unwrap())
    });
    safetensors::serialize_to_file(views, None, to).unwrap();
}

#[test]
fn wide_image_is_padded_above_and_below() {
    let mut planes = vec![0.0; 3 * 4 * 4];
    resize_with_pad(&[255; 4 * 2 * 3], [2, 4], 4, -3.0, &mut planes);
    for plane in planes.chunks_exact(16) {
        let rows: Vec<f32> = plane.chunks_exact(4).map(|row| row[0]).collect();
        assert_eq!(rows, [-3.0, 1.0, 1.0, -3.0]);
    }
}
