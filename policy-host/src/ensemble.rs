//! Temporal ensembling: a query every control step, and the mean of all predictions for that step.
//!
//! At control step `t` the executed row is `Σ wᵢ·aᵢ / Σ wᵢ` over the predictions for `t` in the last `horizon` chunks,
//! oldest first, with `wᵢ = exp(−m·i)`: for a decay `m` above zero the oldest weighs most (spec/eval.md §1.5).

use ipc_types::{Morphology, ObservationView};

use crate::policy::{ActionChunk, Policy, PolicyError};

/// Slots that can be followed: a bound on memory, far above what a sim has.
const MAX_SLOTS: u32 = 4096;

/// A policy whose chunks are ensembled. It answers with one row.
pub struct Ensemble {
    inner: Box<dyn Policy>,
    /// By slot.
    pasts: Vec<Past>,
    /// `exp(−m·i)` for each robot, by its code, as many as its longest chunk has had rows.
    weights: [Vec<f64>; Morphology::ALL.len()],
}

/// The latest chunks of one slot's episode.
struct Past {
    /// The query expected next; 0 before the first episode.
    next_query: u32,
    /// `[horizon, horizon, action_dim]`: the chunk of query `q` at `q % horizon`.
    chunks: Vec<f32>,
}

impl Ensemble {
    /// Ensembles the chunks of `inner`, which must have the same number of rows in every answer to a slot's episode.
    #[must_use]
    pub fn new(inner: Box<dyn Policy>) -> Self {
        Self { inner, pasts: Vec::new(), weights: Default::default() }
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
        answer: &mut [ActionChunk],
    ) -> Result<(), PolicyError> {
        self.check(observation)?;
        self.inner.act(observation, answer)?;
        let morphology = observation.morphology();
        let decay = self.inner.ensemble_decay(morphology);
        let weights = &mut self.weights[morphology.code() as usize];
        for (env_idx, chunk) in answer.iter_mut().enumerate() {
            let record = observation.env(env_idx).record;
            let slot = record.slot as usize;
            if slot >= self.pasts.len() {
                self.pasts.resize_with(slot + 1, || Past { next_query: 0, chunks: Vec::new() });
            }
            let past = &mut self.pasts[slot];
            past.push(record.query, chunk);
            let action_dim = chunk.action_dim();
            let horizon = chunk.rows().len() / action_dim;
            weights.extend((weights.len()..horizon).map(|idx| libm::exp(-decay * idx as f64)));
            past.mean(horizon, weights, chunk.reset(1, action_dim));
        }
        Ok(())
    }
}

impl Past {
    fn push(&mut self, query: u32, chunk: &ActionChunk) {
        let rows = chunk.rows();
        let horizon = rows.len() / chunk.action_dim();
        self.chunks.resize(horizon * rows.len(), 0.0);
        self.chunks[query as usize % horizon * rows.len()..][..rows.len()].copy_from_slice(rows);
        self.next_query = query + 1;
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
                    let chunk = (newest - age) % horizon;
                    weights[idx] * f64::from(self.chunks[(chunk * horizon + age) * action_dim + entry])
                })
                .sum();
            *x = (sum / total) as f32;
        }
    }
}
