//! ACT against PyTorch's outputs for the same observations, recorded by `python/make_act_checkpoint.py`.

use ipc_types::Morphology;
use policy_host::models::act::checkpoint::colosseum::ActConfig;
use policy_host::models::synthetic;
use policy_host::nn::Precision;
use policy_host::{QueryMode, load};
use safetensors::SafeTensors;

use crate::batch::ObservationBatch;
use crate::{act_spec, data, rows};

/// Maximum absolute difference of an action entry.
const TOLERANCE: f32 = 1e-4;
/// Maximum RMS error of 8-bit inference, relative to the standard deviation of the actions.
const INT8_TOLERANCE: f32 = 0.05;

/// Returns the actions that PyTorch computed for envs 0 and 1.
fn expected_actions(file: &str) -> Vec<f32> {
    let bytes = std::fs::read(data(file)).unwrap();
    let tensors = SafeTensors::deserialize(&bytes).unwrap();
    let actions = tensors.tensor("actions").unwrap();
    assert_eq!(actions.shape()[..2], [2, 30]);
    actions.data().as_chunks::<4>().0.iter().map(|&x| f32::from_le_bytes(x)).collect()
}

pub(crate) fn assert_parity(policy: &mut dyn policy_host::Policy, morphology: Morphology, reference: &str) {
    let answer = ObservationBatch::of(morphology, &[0, 1]).answer(policy);
    let actions: Vec<f32> = answer.iter().flat_map(rows).copied().collect();
    let expected = expected_actions(reference);
    assert_eq!(actions.len(), expected.len());
    let max_error = actions.iter().zip(&expected).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
    assert!(max_error <= TOLERANCE, "{reference}: {max_error}");
}

#[test]
fn tiny_checkpoints_agree_with_pytorch() {
    let spec = act_spec(data("act-tiny"));
    let mut policy = load(&spec, 1, QueryMode::Chunk, &Morphology::ALL).unwrap();
    for morphology in Morphology::ALL {
        assert_parity(
            &mut *policy,
            morphology,
            &format!("act-tiny/{}/reference.safetensors", morphology.name()),
        );
    }
}

#[test]
fn full_size_networks_agree_with_pytorch() {
    for morphology in Morphology::ALL {
        let mut policy = synthetic::policy(&ActConfig::full_size(morphology), 0, Precision::F32, 2);
        assert_parity(&mut policy, morphology, &format!("act-full-{}.safetensors", morphology.name()));
    }
}

#[test]
fn int8_error_of_full_size_networks_is_small() {
    for morphology in Morphology::ALL {
        let mut policy = synthetic::policy(&ActConfig::full_size(morphology), 0, Precision::Int8, 2);
        let answer = ObservationBatch::of(morphology, &[0, 1]).answer(&mut policy);
        let expected = expected_actions(&format!("act-full-{}.safetensors", morphology.name()));
        let mean = expected.iter().sum::<f32>() / expected.len() as f32;
        let squares = |differences: &mut dyn Iterator<Item = f32>| differences.map(|x| x * x).sum::<f32>();
        let spread = squares(&mut expected.iter().map(|x| x - mean));
        let found = answer.iter().flat_map(rows);
        let relative_error = (squares(&mut found.zip(&expected).map(|(x, y)| x - y)) / spread).sqrt();
        assert!(
            relative_error > 0.0 && relative_error < INT8_TOLERANCE,
            "{}: {relative_error}",
            morphology.name()
        );
    }
}
