//! The [`Policy`] that runs π0.5 networks on a GPU.

use std::path::Path;
use std::sync::Arc;

use ipc_types::{Morphology, ObservationView};

use super::network::GpuPi05Network;
use crate::models::LoadGpuError;
use crate::models::in_flight::{ObservationInFlight, ObservationsInFlight};
use crate::models::pi05::checkpoint::Pi05Checkpoint;
use crate::models::pi05::policy::{Pi05Network, flop_per_query, load_networks};
use crate::nn::Precision;
use crate::nn::gpu::{GpuDevice, GpuError};
use crate::policy::{ActionChunk, Policy, PolicyError, PolicyPipeline, Stopwatch};

/// π0.5 on a device, with one network per morphology in its checkpoint folder.
#[derive(Debug)]
pub struct GpuPi05Policy {
    networks: Vec<Pi05Network<GpuPi05Network>>,
    in_flight: ObservationsInFlight,
    gpu: Arc<GpuDevice>,
}

impl GpuPi05Policy {
    /// Loads the networks for `robots` in `folder` onto a device, with weights as stored. `n_steps` is the
    /// number of Euler steps from noise to actions; the checkpoint's own by default.
    ///
    /// # Errors
    /// The first file or tensor that is missing, unexpected or damaged, or the failure of the device.
    pub fn load(
        gpu: GpuDevice,
        folder: &Path,
        n_steps: Option<usize>,
        robots: &[Morphology],
    ) -> Result<Self, LoadGpuError> {
        let gpu = Arc::new(gpu);
        let load = |checkpoint: &Pi05Checkpoint, n_steps| checkpoint.load_on_gpu(&gpu, n_steps);
        let networks = load_networks(folder, n_steps, robots, load)?;
        Ok(Self { networks, in_flight: ObservationsInFlight::default(), gpu })
    }
}

impl Policy for GpuPi05Policy {
    fn act(
        &mut self,
        observation: &ObservationView<'_>,
        answer: &mut [ActionChunk],
    ) -> Result<(), PolicyError> {
        self.submit(observation)?;
        self.collect(observation, answer)
    }

    fn pipeline(&mut self) -> Option<&mut dyn PolicyPipeline> {
        Some(self)
    }

    fn flop_per_query(&self, morphology: Morphology, _execute: u32) -> u64 {
        flop_per_query(&self.networks, morphology)
    }

    fn note(&self, _execute: u32, _stopwatch: Stopwatch<'_>) -> Option<String> {
        let notes = self.networks.iter().map(|network| network.processor.note(Precision::F32));
        Some(notes.collect::<Vec<_>>().join("; "))
    }
}

impl PolicyPipeline for GpuPi05Policy {
    fn submit(&mut self, observation: &ObservationView<'_>) -> Result<(), PolicyError> {
        let morphology = observation.morphology();
        let index = self.networks.iter().position(|network| network.morphology() == morphology);
        let index = index.ok_or(PolicyError::Morphology { found: morphology.name() })?;
        let Pi05Network { model, processor } = &mut self.networks[index];
        processor.check(observation)?;
        // All that an observation can be refused for comes before the first part is submitted.
        let prompts = processor.prompts(observation)?;
        let capacity = model.capacity();
        let parts = (0..).step_by(capacity).zip(prompts.chunks(capacity)).map(|(first_env, prompts)| {
            let batch = processor.batch(observation, first_env, prompts);
            model.submit(batch.input(), &batch.noise)
        });
        let parts = parts.collect::<Result<_, GpuError>>()?;
        self.in_flight.push(ObservationInFlight { network: index, parts });
        Ok(())
    }

    fn is_ready(&mut self) -> bool {
        self.in_flight.is_ready(&self.gpu)
    }

    fn collect(
        &mut self,
        observation: &ObservationView<'_>,
        answer: &mut [ActionChunk],
    ) -> Result<(), PolicyError> {
        assert_eq!(answer.len(), observation.n_envs(), "one chunk per env");
        let ObservationInFlight { network, parts } = self.in_flight.pop();
        let Pi05Network { model, processor } = &mut self.networks[network];
        for (part, answer) in parts.into_iter().zip(answer.chunks_mut(model.capacity())) {
            model.collect(part, |actions| processor.write_chunks(actions, answer))?;
        }
        Ok(())
    }

    fn discard(&mut self) -> Result<(), PolicyError> {
        let ObservationInFlight { network, parts } = self.in_flight.pop();
        for part in parts {
            self.networks[network].model.collect(part, |_| ())?;
        }
        Ok(())
    }
}
