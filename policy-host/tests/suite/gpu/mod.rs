//! ACT on a software Vulkan driver: the same outputs as PyTorch's, and the same bits in every batch.

pub(crate) mod kernels;
mod sequences;

use std::path::Path;

use ipc_types::{ImageSizes, Morphology};
use policy_host::models::act::GpuActPolicy;
use policy_host::models::act::checkpoint::colosseum::ActConfig;
use policy_host::nn::gpu::{AdapterKind, GpuDevice};
use policy_host::policy::ensemble::Ensemble;
use policy_host::policy::{ActionChunk, Policy, PolicyPipeline};
use run_config::DeviceChoice;

use policy_host::models::synthetic::write_checkpoint;

use crate::act::lerobot::assert_actions_agree;
use crate::act::parity::assert_parity;
use crate::batch::ObservationBatch;
use crate::{data, rows};

/// Loads the tiny checkpoint.
fn policy() -> GpuActPolicy {
    load(&data("act-tiny"), &Morphology::ALL)
}

fn load(folder: &Path, robots: &[Morphology]) -> GpuActPolicy {
    GpuActPolicy::load(device(), folder, robots, ImageSizes::BENCHMARK).unwrap()
}

/// Opens the device of the tests: a software driver, unless the environment variable `HYPOGEUM_TEST_DEVICE`
/// is `gpu`.
pub(crate) fn device() -> GpuDevice {
    let kind = match device_choice() {
        DeviceChoice::Gpu => AdapterKind::Hardware,
        _ => AdapterKind::Software,
    };
    policy_host::nn::gpu::open(kind, None).unwrap()
}

/// Returns the choice of [`device`].
pub(crate) fn device_choice() -> DeviceChoice {
    match std::env::var("HYPOGEUM_TEST_DEVICE").as_deref() {
        Ok("gpu") => DeviceChoice::Gpu,
        _ => DeviceChoice::Software,
    }
}

fn bits(rows: &[f32]) -> Vec<u32> {
    rows.iter().map(|x| x.to_bits()).collect()
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn device_agrees_with_pytorch() {
    let mut policy = policy();
    for morphology in Morphology::ALL {
        let reference = format!("act-tiny/{}/reference.safetensors", morphology.name());
        assert_parity(&mut policy, morphology, &reference);
    }
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn full_size_network_on_device_agrees_with_pytorch() {
    let morphology = Morphology::Single;
    let folder = tempfile::tempdir().unwrap();
    write_checkpoint(folder.path(), &ActConfig::full_size(morphology), 0).unwrap();
    let mut policy = load(folder.path(), &[morphology]);
    assert_parity(&mut policy, morphology, &format!("act-full-{}.safetensors", morphology.name()));
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn device_agrees_with_lerobot() {
    let mut policy = load(&data("lerobot/robot"), &Morphology::ALL);
    assert_actions_agree(&mut policy);
}

/// The batch of 33 exceeds what the device computes at a time.
#[test]
#[ignore = "needs a Vulkan driver"]
fn actions_on_device_are_independent_of_batch() {
    let mut policy = policy();
    let many: Vec<u32> = (0..33).rev().collect();
    let answer = |envs: &[u32], policy: &mut GpuActPolicy| -> Vec<Vec<u32>> {
        let blocks = ObservationBatch::of(Morphology::Single, envs).answer(policy);
        blocks.iter().map(|block| bits(rows(block))).collect()
    };
    let all = answer(&many, &mut policy);
    assert_ne!(all[0], all[2], "other observations, other actions");
    for envs in [&many[9..12], &[31], &[0]] {
        for (env, bits) in envs.iter().zip(answer(envs, &mut policy)) {
            assert_eq!(bits, all[32 - *env as usize], "env {env} of {envs:?}");
        }
    }
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn fewer_executed_rows_are_the_first_ones() {
    let mut policy = policy();
    let batch = |n_rows| ObservationBatch::of(Morphology::Single, &[1, 2]).executing(n_rows);
    let (whole, few) = (batch(30).answer(&mut policy), batch(4).answer(&mut policy));
    for (whole, few) in whole.iter().zip(&few) {
        assert_eq!((whole.n_rows, few.n_rows), (30, 4));
        assert_eq!(bits(rows(few)), bits(&rows(whole)[..rows(few).len()]));
    }
}

#[test]
#[ignore = "needs a Vulkan driver"]
fn batches_in_flight_are_answered_in_order() {
    let policy = policy();
    let chunks = |n: usize| vec![ActionChunk::default(); n];
    let batches = [&[0, 1, 2][..], &[3], &[4, 5]].map(|envs| ObservationBatch::of(Morphology::Single, envs));
    let mut policy = Ensemble::new(Box::new(policy));
    let expected = batches.each_ref().map(|batch| {
        let mut answer = chunks(batch.view().n_envs());
        policy.act(&batch.view(), &mut answer).unwrap();
        answer
    });
    let pipeline: &mut dyn PolicyPipeline = policy.pipeline().expect("the device computes in the background");
    for batch in &batches {
        pipeline.submit(&batch.view()).unwrap();
    }
    for (index, (batch, expected)) in batches.iter().zip(&expected).enumerate() {
        if index == 1 {
            pipeline.discard().unwrap();
            continue;
        }
        let mut answer = chunks(expected.len());
        pipeline.collect(&batch.view(), &mut answer).unwrap();
        for (found, expected) in answer.iter().zip(expected) {
            assert_eq!(bits(found.rows()), bits(expected.rows()), "batch {index}");
        }
    }
    assert!(pipeline.is_ready(), "nothing waits for a batch that is not there");
}
