//! π0.5 on a software Vulkan driver: LeRobot's outputs, and the same bits in every batch.

use std::sync::Arc;

use ipc_types::{EnvRecord, ImageSizes};
use policy_host::load_on;
use policy_host::policy::{ActionChunk, Policy, PolicyError, PolicyPipeline};

use super::*;
use crate::gpu::{device, device_choice};

/// Cases whose checkpoint is in their own folder, and the cameras with recorded images.
const CASES: [(&str, Option<&[&str]>); 4] = [
    ("robot", None),
    ("one_camera", Some(&["hand"])),
    ("missing", Some(&["base_0_rgb", "left_wrist_0_rgb"])),
    ("bf16", None),
];

/// Loads a policy on the device of the tests.
fn policy() -> Box<dyn Policy> {
    let spec: PolicySpec = format!("pi05:{}", data("pi05/robot").display()).parse().unwrap();
    let robots = [Morphology::Single];
    load_on(&spec, device_choice().into(), 1, QueryMode::Chunk, (&robots, ImageSizes::BENCHMARK)).unwrap()
}

/// Returns observations whose prompts have two lengths. Those of 19 envs exceed what the device computes at a
/// time.
fn batches() -> [ObservationBatch; 3] {
    let many: Vec<u32> = (0..19).collect();
    [&many[..], &[21], &[5, 24, 23]].map(|envs| ObservationBatch::of(Morphology::Single, envs))
}

fn bits(chunks: &[ActionChunk]) -> Vec<Vec<u32>> {
    chunks.iter().map(|chunk| chunk.rows().iter().map(|x| x.to_bits()).collect()).collect()
}

/// Returns the answer to a batch that is alone on the device.
fn answer(policy: &mut dyn Policy, batch: &ObservationBatch) -> Vec<Vec<u32>> {
    let mut chunks = vec![ActionChunk::default(); batch.view().n_envs()];
    policy.act(&batch.view(), &mut chunks).unwrap();
    bits(&chunks)
}

/// Returns the answer to the oldest batch in flight.
fn collect(pipeline: &mut dyn PolicyPipeline, batch: &ObservationBatch) -> Vec<Vec<u32>> {
    let mut chunks = vec![ActionChunk::default(); batch.view().n_envs()];
    pipeline.collect(&batch.view(), &mut chunks).unwrap();
    bits(&chunks)
}

#[test]
#[ignore = "needs a Vulkan driver"]
#[expect(clippy::print_stdout, reason = "the differences are worth knowing")]
fn device_agrees_with_lerobot() {
    let gpu = Arc::new(device());
    for (name, cameras) in CASES {
        let case = Case::of(name);
        let checkpoint = Pi05Checkpoint::open(&case.folder).unwrap();
        let mut network = checkpoint.load_on_gpu(&gpu, checkpoint.description().n_steps).unwrap();
        let mut sample = |range: std::ops::Range<usize>| {
            let batch = prepare(&checkpoint, &case, cameras, range);
            let mut actions = batch.noise.clone();
            let input = Pi05Input { images: &batch.pixels, samples: &batch.samples };
            network.sample(input, &mut actions).unwrap();
            (batch.actions(&actions), actions)
        };
        let n = case.instructions.len();
        let (actions, padded) = sample(0..n);
        let errors =
            [max_error(&padded, &case.values("actions32")), max_error(&actions, &case.values("actions"))];
        println!("{name}: {errors:?}");
        assert!(errors.iter().all(|error| *error <= TOLERANCE), "{name}: {errors:?}");
        let alone = (0..n).flat_map(|idx| sample(idx..idx + 1).1);
        assert!(alone.map(f32::to_bits).eq(padded.iter().map(|x| x.to_bits())), "{name}: batch");
    }
}

/// Prompts have two lengths, and several envs of a batch see the same images. The batch of 33 exceeds what
/// the device computes at a time.
#[test]
#[ignore = "needs a Vulkan driver"]
fn actions_on_device_are_independent_of_batch() {
    let mut policy = policy();
    let mut answer_of = |envs: &[u32]| answer(&mut *policy, &ObservationBatch::of(Morphology::Single, envs));
    let many: Vec<u32> = (0..33).map(|idx| idx * 5 % 12).collect();
    let all = answer_of(&many);
    assert_ne!(all[0], all[1], "other observations, other actions");
    for envs in [&[0][..], &[7], &[11], &[3, 1], &[2, 2, 5, 2], &[4, 5, 6, 7, 8, 9, 10, 11]] {
        for (env, bits) in envs.iter().zip(answer_of(envs)) {
            for (_, expected) in many.iter().zip(&all).filter(|(other, _)| *other == env) {
                assert_eq!(&bits, expected, "env {env} of {envs:?}");
            }
        }
    }
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn batches_in_flight_are_answered_in_order() {
    let mut policy = policy();
    let batches = batches();
    let expected = batches.each_ref().map(|batch| answer(&mut *policy, batch));
    assert_ne!(expected[0][5], expected[0][7], "other observations, other actions");
    assert_eq!(expected[0][5], expected[2][0], "the same observation, the same actions");
    let pipeline = policy.pipeline().expect("the device computes in the background");
    let order = [0, 1, 0, 2, 1, 0];
    pipeline.submit(&batches[order[0]].view()).unwrap();
    for (index, batch) in order.into_iter().enumerate() {
        if let Some(&next) = order.get(index + 1) {
            pipeline.submit(&batches[next].view()).unwrap();
        }
        assert_eq!(collect(pipeline, &batches[batch]), expected[batch], "batch {index}");
    }
    assert!(pipeline.is_ready(), "nothing waits for a batch that is not there");
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn discarded_batch_leaves_later_answers_unchanged() {
    let mut policy = policy();
    let [large, single, several] = batches();
    let expected = [&single, &several, &large].map(|batch| answer(&mut *policy, batch));
    let pipeline = policy.pipeline().expect("the device computes in the background");
    for batch in [&single, &large, &several] {
        pipeline.submit(&batch.view()).unwrap();
    }
    assert_eq!(collect(pipeline, &single), expected[0]);
    pipeline.discard().unwrap();
    pipeline.submit(&large.view()).unwrap();
    assert_eq!(collect(pipeline, &several), expected[1]);
    assert_eq!(collect(pipeline, &large), expected[2]);
}

/// The error is in an env that the device would compute after others of its batch.
#[test]
#[ignore = "needs a Vulkan driver"]
fn refused_batch_leaves_later_answers_unchanged() {
    let mut policy = policy();
    let [large, single, several] = batches();
    let expected = [&single, &large, &several].map(|batch| answer(&mut *policy, batch));
    let [mut refused, ..] = batches();
    let last_env = 18 * refused.header.block_pages as usize;
    let record: &mut EnvRecord = bytemuck::cast_mut(&mut refused.pages[last_env]);
    record.state_dim -= 1;
    let state_dim = Morphology::Single.state_dim();
    let error = PolicyError::StateDim { env_idx: 18, expected: state_dim, found: state_dim - 1 };
    let pipeline = policy.pipeline().expect("the device computes in the background");
    pipeline.submit(&single.view()).unwrap();
    assert_eq!(pipeline.submit(&refused.view()), Err(error.clone()));
    pipeline.submit(&large.view()).unwrap();
    assert_eq!(collect(pipeline, &single), expected[0]);
    assert_eq!(pipeline.submit(&refused.view()), Err(error));
    pipeline.submit(&several.view()).unwrap();
    assert_eq!(collect(pipeline, &large), expected[1]);
    assert_eq!(collect(pipeline, &several), expected[2]);
    assert!(pipeline.is_ready(), "nothing waits for a batch that was refused");
}

#[test]
fn weights_in_eight_bits_use_the_cpu() {
    let spec: PolicySpec = format!("pi05-int8:{}", data("pi05/robot").display()).parse().unwrap();
    let error = policy_host::device::find(&[&spec], device_choice().into()).unwrap_err().to_string();
    crate::assert_contains(&error, &["pi05-int8:", "computes on the CPU only", "--policy-device cpu"]);
}
