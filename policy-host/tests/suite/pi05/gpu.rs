//! π0.5 on a software Vulkan driver: LeRobot's outputs, and the same bits in every batch.

use std::sync::Arc;

use ipc_types::run_config::DeviceChoice;
use policy_host::load_on;

use super::*;
use crate::gpu::device;

/// Cases whose checkpoint is in their own folder, and the cameras with recorded images.
const CASES: [(&str, Option<&[&str]>); 4] = [
    ("robot", None),
    ("one_camera", Some(&["hand"])),
    ("missing", Some(&["base_0_rgb", "left_wrist_0_rgb"])),
    ("bf16", None),
];

#[test]
#[expect(clippy::print_stdout, reason = "the differences are worth knowing")]
fn device_agrees_with_lerobot() {
    let Some(gpu) = device().map(Arc::new) else { return };
    for (name, cameras) in CASES {
        let case = Case::of(name);
        let checkpoint = Pi05Checkpoint::open(&case.folder).unwrap();
        let network = checkpoint.load_on_gpu(&gpu, checkpoint.description().n_steps).unwrap();
        let sample = |range: std::ops::Range<usize>| {
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
fn actions_on_device_are_independent_of_batch() {
    if device().is_none() {
        return;
    }
    let spec: PolicySpec = format!("pi05:{}", data("pi05/robot").display()).parse().unwrap();
    let robots = [Morphology::Single];
    let mut policy = load_on(&spec, DeviceChoice::Software.into(), 1, QueryMode::Chunk, &robots).unwrap();
    let mut answer = |envs: &[u32]| -> Vec<Vec<u32>> {
        let blocks = ObservationBatch::of(Morphology::Single, envs).answer(&mut *policy);
        blocks.iter().map(|block| crate::rows(block).iter().map(|x| x.to_bits()).collect()).collect()
    };
    let many: Vec<u32> = (0..33).map(|idx| idx * 5 % 12).collect();
    let all = answer(&many);
    assert_ne!(all[0], all[1], "other observations, other actions");
    for envs in [&[0][..], &[7], &[11], &[3, 1], &[2, 2, 5, 2], &[4, 5, 6, 7, 8, 9, 10, 11]] {
        for (env, bits) in envs.iter().zip(answer(envs)) {
            for (_, expected) in many.iter().zip(&all).filter(|(other, _)| *other == env) {
                assert_eq!(&bits, expected, "env {env} of {envs:?}");
            }
        }
    }
}

#[test]
fn weights_in_eight_bits_use_the_cpu() {
    let spec: PolicySpec = format!("pi05-int8:{}", data("pi05/robot").display()).parse().unwrap();
    let error = policy_host::device::find(&[&spec], DeviceChoice::Software.into()).unwrap_err().to_string();
    crate::assert_contains(&error, &["pi05-int8:", "computes on the CPU only", "--policy-device cpu"]);
}
