//! Temporal ensembling against its definition: store every prediction, sum once per control step.

use ipc_types::{Morphology, ObservationView};
use policy_host::generated::sym;
use policy_host::policy::ensemble::Ensemble;
use policy_host::{ActionChunk, Policy, PolicyError};

use crate::batch::ObservationBatch;
use crate::rows;

const HORIZON: usize = 30;
const ACTION_DIM: usize = 7;

/// A policy whose predictions are distinct for every episode, query and row.
struct Predictions;

/// Returns the prediction at `query` for step `query + ahead` in the episode with this seed.
fn predicted(seed: u64, query: u32, ahead: usize, entry: usize) -> f32 {
    sym(seed, (query as usize * HORIZON + ahead) * ACTION_DIM + entry, 1.0)
}

impl Policy for Predictions {
    fn act(
        &mut self,
        observation: &ObservationView<'_>,
        answer: &mut [ActionChunk],
    ) -> Result<(), PolicyError> {
        for (env_idx, chunk) in answer.iter_mut().enumerate() {
            let record = observation.env(env_idx).record;
            for (idx, x) in chunk.reset(HORIZON, ACTION_DIM).iter_mut().enumerate() {
                *x = predicted(record.policy_seed, record.query, idx / ACTION_DIM, idx % ACTION_DIM);
            }
        }
        Ok(())
    }
}

/// Creates the observations of slots, given as (slot, query, episode seed).
fn batch(slots: &[(u32, u32, u64)]) -> ObservationBatch {
    let envs: Vec<u32> = slots.iter().map(|&(slot, ..)| slot).collect();
    let mut batch = ObservationBatch::of(Morphology::Single, &envs);
    let block_pages = batch.header.block_pages as usize;
    for (page, &(_, query, seed)) in batch.pages.iter_mut().step_by(block_pages).zip(slots) {
        let record: &mut ipc_types::EnvRecord = bytemuck::cast_mut(page);
        (record.query, record.step, record.policy_seed) = (query, query, seed);
    }
    batch
}

/// Evaluates the definition (docs/benchmark.md, "Policies and evaluation") in f64.
fn expected(seed: u64, step: u32, entry: usize) -> f64 {
    let first = (step + 1).saturating_sub(HORIZON as u32);
    let weights = (0..).map(|idx| libm::exp(-0.01 * f64::from(idx)));
    let terms: Vec<(f64, f64)> = (first..=step)
        .map(|query| f64::from(predicted(seed, query, (step - query) as usize, entry)))
        .zip(weights)
        .collect();
    let total: f64 = terms.iter().map(|(_, weight)| weight).sum();
    terms.iter().map(|(x, weight)| x * weight).sum::<f64>() / total
}

#[test]
fn rows_equal_weighted_mean_of_all_predictions() {
    let mut policy = Ensemble::new(Box::new(Predictions));
    // Slot 5 joins late, slot 2 starts a second episode after 40 steps.
    for tick in 0..80_u32 {
        let second = tick >= 40;
        let mut slots = vec![(2, tick - if second { 40 } else { 0 }, if second { 8 } else { 7 })];
        slots.extend((tick >= 10).then(|| (5, tick - 10, 9)));
        let answer = batch(&slots).answer(&mut policy);
        for (&(slot, query, seed), block) in slots.iter().zip(&answer) {
            assert_eq!((block.slot, block.query, block.n_rows), (slot, query, 1));
            for (entry, &x) in rows(block).iter().enumerate() {
                let expected = expected(seed, query, entry);
                assert!(
                    (f64::from(x) - expected).abs() < 1e-6,
                    "slot {slot} step {query}: {x}, not {expected}"
                );
            }
        }
    }
}

#[test]
fn query_gap_is_rejected_without_side_effects() {
    let mut policy = Ensemble::new(Box::new(Predictions));
    batch(&[(0, 0, 1), (1, 0, 2)]).answer(&mut policy);
    let with_gap = batch(&[(0, 1, 1), (1, 2, 2)]);
    let error =
        policy.act(&with_gap.view(), &mut [ActionChunk::default(), ActionChunk::default()]).unwrap_err();
    assert_eq!(error, PolicyError::QueryGap { slot: 1, expected: 1, found: 2 });
    let answer = batch(&[(0, 1, 1), (1, 1, 2)]).answer(&mut policy);
    assert!((f64::from(rows(&answer[1])[3]) - expected(2, 1, 3)).abs() < 1e-6);

    let far = batch(&[(1 << 20, 0, 1)]);
    let error = policy.act(&far.view(), &mut [ActionChunk::default()]).unwrap_err();
    assert!(matches!(error, PolicyError::Slot { slot: 0x10_0000, .. }), "{error}");
}
