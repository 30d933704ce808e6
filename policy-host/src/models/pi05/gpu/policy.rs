//! π0.5 networks as a policy on a GPU runs them.

use std::sync::Arc;

use ipc_types::{Morphology, ObservationView};

use super::network::GpuPi05Network;
use crate::models::family::NetworkSource;
use crate::models::pi05::checkpoint::Pi05Checkpoint;
use crate::models::pi05::policy::{Pi05Network, load_networks};
use crate::models::{DeviceNetwork, GpuPolicy, LoadGpuError};
use crate::nn::Precision;
use crate::nn::gpu::transfer::BatchInFlight;
use crate::nn::gpu::{GpuDevice, GpuError};
use crate::policy::{ActionChunk, PolicyError};

/// π0.5 on a device, with one network per morphology in its checkpoint folder.
pub(crate) type GpuPi05Policy = GpuPolicy<Pi05Network<GpuPi05Network>>;

impl GpuPi05Policy {
    /// Loads the networks for `robots` onto a device, with weights as stored.
    pub(crate) fn load(
        source: &NetworkSource,
        gpu: GpuDevice,
        robots: &[Morphology],
    ) -> Result<Self, LoadGpuError> {
        let gpu = Arc::new(gpu);
        let load = |checkpoint: &Pi05Checkpoint, n_steps| checkpoint.load_on_gpu(&gpu, n_steps);
        Ok(Self::new(load_networks(source, robots, load)?, Arc::clone(&gpu)))
    }
}

impl DeviceNetwork for Pi05Network<GpuPi05Network> {
    fn morphology(&self) -> Morphology {
        self.processor.description.mapping.morphology
    }

    fn capacity(&self) -> usize {
        self.model.capacity()
    }

    fn submit(
        &mut self,
        _gpu: &GpuDevice,
        observation: &ObservationView<'_>,
    ) -> Result<Vec<BatchInFlight>, PolicyError> {
        let Self { model, processor } = self;
        processor.description.mapping.check(observation)?;
        // All that an observation can be refused for comes before the first batch is submitted.
        let prompts = processor.prompts(observation)?;
        let capacity = model.capacity();
        let batches = (0..).step_by(capacity).zip(prompts.chunks(capacity)).map(|(first_env, prompts)| {
            let batch = processor.batch(observation, first_env, prompts);
            Ok(model.submit(batch.input(), &batch.noise)?)
        });
        batches.collect()
    }

    fn collect<'a>(
        &mut self,
        _gpu: &GpuDevice,
        batch: BatchInFlight,
        _n_rows: &dyn Fn(usize, usize) -> usize,
        state: &dyn Fn(usize) -> &'a [f32],
        answer: &mut [ActionChunk],
    ) -> Result<(), GpuError> {
        self.model.collect(batch, |actions| self.processor.write_chunks(actions, state, answer))
    }

    fn flop_per_query(&self) -> u64 {
        self.processor.flop_per_query()
    }

    fn startup_message(&self) -> Option<String> {
        Some(self.processor.startup_message(Precision::F32))
    }
}
