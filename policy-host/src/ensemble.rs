//! Temporal ensembling: a query every control step, and the mean of all predictions for that step.
//!
//! At control step `t` the executed row is `Σ wᵢ·aᵢ / Σ wᵢ` over the predictions for `t` in the last `horizon` chunks,
//! oldest first, with `wᵢ = exp(−0.01·i)`: the oldest weighs most (spec/eval.md §1.5).

use ipc_types::layout::{MAX_ACTION_DIM, MAX_HORIZON};
use ipc_types::{ActionBlock, ObservationView};

use crate::policy::{Policy, PolicyError, begin_answer};

/// Decay of the weights per prediction.
const DECAY: f64 = 0.01;
/// Slots that can be followed: a bound on memory, far above what a sim has.
const MAX_SLOTS: u32 = 4096;

/// A policy whose chunks are ensembled. It answers with one row.
pub struct Ensemble {
    inner: Box<dyn Policy>,
    /// By slot.
    pasts: Vec<Past>,
    /// `exp(−0.01·i)`.
    weights: [f64; MAX_HORIZON],
}

/// The latest chunks of one slot's episode.
struct Past {
    /// The query expected next; 0 before the first episode.
    next_query: u32,
    /// Chunk of query `q` at `q % horizon`.
    chunks: Vec<[f32; MAX_HORIZON * MAX_ACTION_DIM]>,
}

impl Ensemble {
    /// Ensembles the chunks of `inner`, which must have the same number of rows in every answer to a slot's episode.
    #[must_use]
    pub fn new(inner: Box<dyn Policy>) -> Self {
        Self { inner, pasts: Vec::new(), weights: std::array::from_fn(|idx| (-DECAY * idx as f64).exp()) }
    }

    fn check(&self, observation: &ObservationView<'_>) -> Result<(), PolicyError> {
        for env_idx in 0..observation.n_envs() {
            let record = observation.env(env_idx).record;
            let (slot, found) = (record.slot, record.query);
            if slot >= MAX_SLOTS {
                return Err(PolicyError::Slot { slot, limit: MAX_SLOTS });
            }
            let expected = self.pasts.get(slot as usize).map_or(0, |past| past.next_query);
            if found != 0 && found != expected {
                return Err(PolicyError::QueryGap { slot, expected, found });
            }
        }
        Ok(())
    }
}

impl Policy for Ensemble {
    fn act(
        &mut self,
        observation: &ObservationView<'_>,
        answer: &mut [ActionBlock],
    ) -> Result<(), PolicyError> {
        self.check(observation)?;
        self.inner.act(observation, answer)?;
        for (env_idx, block) in answer.iter_mut().enumerate() {
            let slot = block.slot as usize;
            if slot >= self.pasts.len() {
                self.pasts.resize_with(slot + 1, || Past { next_query: 0, chunks: Vec::new() });
            }
            let past = &mut self.pasts[slot];
            past.push(block);
            let (horizon, action_dim) = (block.n_rows as usize, block.action_dim as usize);
            let row = begin_answer(block, observation.env(env_idx).record, 1, action_dim);
            past.mean(horizon, &self.weights, row);
        }
        Ok(())
    }
}

impl Past {
    fn push(&mut self, block: &ActionBlock) {
        let horizon = block.n_rows as usize;
        if self.chunks.len() < horizon {
            self.chunks.resize(horizon, [0.0; MAX_HORIZON * MAX_ACTION_DIM]);
        }
        self.chunks[block.query as usize % horizon] = block.rows;
        self.next_query = block.query + 1;
    }

    /// The weighted mean for the control step of the newest chunk, summed oldest first.
    fn mean(&self, horizon: usize, weights: &[f64], row: &mut [f32]) {
        let newest = self.next_query as usize - 1;
        let n_past = horizon.min(newest + 1);
        let total: f64 = weights[..n_past].iter().sum();
        let action_dim = row.len();
        for (entry, x) in row.iter_mut().enumerate() {
            let sum: f64 = (0..n_past)
                .map(|idx| {
                    let age = n_past - 1 - idx;
                    let chunk = &self.chunks[(newest - age) % horizon];
                    weights[idx] * f64::from(chunk[age * action_dim + entry])
                })
                .sum();
            *x = (sum / total) as f32;
        }
    }
}
