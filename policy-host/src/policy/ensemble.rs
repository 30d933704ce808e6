//! Temporal ensembling: the policy is queried at every control step, and the executed action is a weighted
//! mean of all predictions for that step.
//!
//! The action at control step `t` is `Σ wᵢ·aᵢ / Σ wᵢ` over the predictions for `t` in the last `horizon`
//! chunks, oldest first, with `wᵢ = exp(−m·i)`. With a positive decay `m` the oldest prediction has the
//! largest weight (Zhao et al., Learning fine-grained bimanual manipulation with low-cost hardware, 2023,
//! section 4).

use ipc_types::{Morphology, ObservationView};
use run_config::MAX_ENVS;

use super::{ActionChunk, Policy, PolicyError, PolicyPipeline};

/// Upper bound on slot indices, which limits memory.
const MAX_SLOTS: u32 = MAX_ENVS;

/// A policy that ensembles the chunks of another one. Its chunks have one row.
pub struct Ensemble {
    inner: Box<dyn Policy>,
    /// Chunk history of each slot.
    histories: Vec<ChunkHistory>,
    /// Weights `exp(−m·i)` per morphology code, as many as the longest chunk so far has rows.
    weights: [Vec<f64>; Morphology::ALL.len()],
}

/// The latest chunks of the current episode of a slot.
struct ChunkHistory {
    /// Query index expected next; 0 before the first episode.
    next_query: u32,
    /// Ring buffer `[horizon, horizon, action_dim]` with the chunk of query `q` at index `q % horizon`.
    chunks: Vec<f32>,
}

impl Ensemble {
    /// Wraps `inner`, whose chunks must have the same number of rows throughout an episode.
    #[must_use]
    pub fn new(mut inner: Box<dyn Policy>) -> Self {
        inner.compute_whole_chunks();
        Self { inner, histories: Vec::new(), weights: Default::default() }
    }

    fn check(&self, observation: &ObservationView<'_>) -> Result<(), PolicyError> {
        for env_idx in 0..observation.n_envs() {
            let record = observation.env(env_idx).record;
            let (slot, found) = (record.slot, record.query);
            if slot >= MAX_SLOTS {
                return Err(PolicyError::Slot { slot, limit: MAX_SLOTS });
            }
            let expected = self.histories.get(slot as usize).map_or(0, |history| history.next_query);
            if found != 0 && found != expected {
                return Err(PolicyError::QueryGap { slot, expected, found });
            }
        }
        Ok(())
    }

    /// Adds the chunks of a batch to the histories and replaces each by the mean of all predictions.
    fn combine(&mut self, observation: &ObservationView<'_>, answer: &mut [ActionChunk]) {
        let morphology = observation.morphology();
        let decay = self.inner.ensemble_decay(morphology);
        let weights = &mut self.weights[morphology.code() as usize];
        for (env_idx, chunk) in answer.iter_mut().enumerate() {
            let record = observation.env(env_idx).record;
            let slot = record.slot as usize;
            if slot >= self.histories.len() {
                self.histories.resize_with(slot + 1, || ChunkHistory { next_query: 0, chunks: Vec::new() });
            }
            let history = &mut self.histories[slot];
            history.push(record.query, chunk);
            let action_dim = chunk.action_dim();
            let horizon = chunk.rows().len() / action_dim;
            weights.extend((weights.len()..horizon).map(|idx| libm::exp(-decay * idx as f64)));
            history.mean(horizon, weights, chunk.reset(1, action_dim));
        }
    }

    /// Returns the pipeline of the ensembled policy.
    fn device(&mut self) -> &mut dyn PolicyPipeline {
        self.inner.pipeline().expect("an ensemble has a pipeline only if its policy has one")
    }
}

impl PolicyPipeline for Ensemble {
    fn submit(&mut self, observation: &ObservationView<'_>) -> Result<(), PolicyError> {
        // A slot is in one batch at a time, so that its history is complete here.
        self.check(observation)?;
        self.device().submit(observation)
    }

    fn is_ready(&mut self) -> bool {
        self.device().is_ready()
    }

    fn collect(
        &mut self,
        observation: &ObservationView<'_>,
        answer: &mut [ActionChunk],
    ) -> Result<(), PolicyError> {
        self.device().collect(observation, answer)?;
        self.combine(observation, answer);
        Ok(())
    }

    fn discard(&mut self) -> Result<(), PolicyError> {
        self.device().discard()
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
        self.combine(observation, answer);
        Ok(())
    }

    fn pipeline(&mut self) -> Option<&mut dyn PolicyPipeline> {
        if self.inner.pipeline().is_some() { Some(self) } else { None }
    }

    fn run_benchmark(&self) -> u64 {
        self.inner.run_benchmark()
    }

    fn startup_message(&self, _execute: u32, flop_per_s: f64) -> Option<String> {
        self.inner.startup_message(1, flop_per_s)
    }

    fn flop_per_query(&self, morphology: Morphology, execute: u32) -> u64 {
        self.inner.flop_per_query(morphology, execute)
    }
}

impl ChunkHistory {
    fn push(&mut self, query: u32, chunk: &ActionChunk) {
        let rows = chunk.rows();
        let horizon = rows.len() / chunk.action_dim();
        self.chunks.resize(horizon * rows.len(), 0.0);
        self.chunks[query as usize % horizon * rows.len()..][..rows.len()].copy_from_slice(rows);
        self.next_query = query + 1;
    }

    /// Writes the weighted mean of the predictions for the newest control step to `row [action_dim]`, summed
    /// oldest first.
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
