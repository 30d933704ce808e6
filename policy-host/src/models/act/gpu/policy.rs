//! The [`Policy`] that runs ACT networks on a GPU.

use std::path::Path;

use ipc_types::{Morphology, ObservationView};

use super::network::GpuNetwork;
use crate::formats::ObservationMapping;
use crate::models::LoadGpuError;
use crate::models::act::checkpoint::{StoredNetwork, load_networks};
use crate::models::act::leading::TokenCache;
use crate::models::act::policy::ChunkRows;
use crate::models::in_flight::{ObservationInFlight, ObservationsInFlight};
use crate::nn::gpu::transfer::BatchInFlight;
use crate::nn::gpu::{GpuDevice, GpuError};
use crate::policy::{ActionChunk, DEFAULT_ENSEMBLE_DECAY, Policy, PolicyError, PolicyPipeline};

/// ACT on a device, with one network per morphology.
#[derive(Debug)]
pub struct GpuActPolicy {
    networks: Vec<DeviceNetwork>,
    rows: ChunkRows,
    in_flight: ObservationsInFlight,
    gpu: GpuDevice,
}

#[derive(Debug)]
struct DeviceNetwork {
    gpu: GpuNetwork,
    mapping: ObservationMapping,
    ensemble_decay: Option<f64>,
    tokens: TokenCache,
    /// Network state input `[state_dim]` of the current sample.
    state: Vec<f32>,
}

impl GpuActPolicy {
    /// Loads the networks for `robots` in `folder` onto a device.
    ///
    /// # Errors
    /// The first file or tensor that is missing, unexpected or damaged, or the failure of the device.
    pub fn load(gpu: GpuDevice, folder: &Path, robots: &[Morphology]) -> Result<Self, LoadGpuError> {
        let networks = load_networks(folder, robots, |stored| {
            let network = GpuNetwork::new(&gpu, &stored)?;
            let StoredNetwork { mapping, encoder, ensemble_decay, architecture, .. } = stored;
            let (tokens, state) = (TokenCache::new(encoder), vec![0.0; architecture.state_dim.unwrap_or(0)]);
            Ok::<_, LoadGpuError>(DeviceNetwork { gpu: network, mapping, ensemble_decay, tokens, state })
        })?;
        Ok(Self { networks, rows: ChunkRows::Executed, in_flight: ObservationsInFlight::default(), gpu })
    }

    fn network(&self, morphology: Morphology) -> Option<&DeviceNetwork> {
        self.networks.iter().find(|network| network.mapping.morphology == morphology)
    }
}

impl Policy for GpuActPolicy {
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

    fn compute_whole_chunks(&mut self) {
        self.rows = ChunkRows::All;
    }

    fn flop_per_query(&self, morphology: Morphology, _execute: u32) -> u64 {
        self.network(morphology).map_or(0, |network| {
            let architecture = &network.gpu.architecture;
            architecture.flop_per_query(architecture.horizon)
        })
    }

    fn ensemble_decay(&self, morphology: Morphology) -> f64 {
        self.network(morphology).and_then(|network| network.ensemble_decay).unwrap_or(DEFAULT_ENSEMBLE_DECAY)
    }
}

impl PolicyPipeline for GpuActPolicy {
    fn submit(&mut self, observation: &ObservationView<'_>) -> Result<(), PolicyError> {
        let morphology = observation.morphology();
        let index = self.networks.iter().position(|network| network.mapping.morphology == morphology);
        let index = index.ok_or(PolicyError::Morphology { found: morphology.name() })?;
        let network = &mut self.networks[index];
        network.mapping.check(observation)?;
        let (n_envs, capacity) = (observation.n_envs(), network.gpu.capacity());
        let parts = (0..n_envs).step_by(capacity).map(|first_env| {
            let n_samples = capacity.min(n_envs - first_env);
            network.submit(&self.gpu, observation, first_env, n_samples)
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
        let network = &mut self.networks[network].gpu;
        let (capacity, action_dim) = (network.capacity(), network.architecture.action_dim);
        for ((part, chunks), first_env) in
            parts.into_iter().zip(answer.chunks_mut(capacity)).zip((0..).step_by(capacity))
        {
            let accept = |sample: usize, actions: &[f32]| {
                let execute = observation.env(first_env + sample).record.execute;
                let n_rows = self.rows.count(execute, actions.len() / action_dim);
                chunks[sample].reset(n_rows, action_dim).copy_from_slice(&actions[..n_rows * action_dim]);
            };
            network.collect(&self.gpu, part, accept)?;
        }
        Ok(())
    }

    fn discard(&mut self) -> Result<(), PolicyError> {
        let ObservationInFlight { network, parts } = self.in_flight.pop();
        let network = &mut self.networks[network].gpu;
        for part in parts {
            network.collect(&self.gpu, part, |_, _| ())?;
        }
        Ok(())
    }
}

impl DeviceNetwork {
    /// Submits the envs starting at `first_env`.
    fn submit(
        &mut self,
        gpu: &GpuDevice,
        observation: &ObservationView<'_>,
        first_env: usize,
        n_samples: usize,
    ) -> Result<BatchInFlight, GpuError> {
        let Self { gpu: network, mapping, tokens, state, .. } = self;
        for sample in 0..n_samples {
            let env = observation.env(first_env + sample);
            mapping.gather_state(env.state, state);
            let instruction = tokens.get(env.instruction, &network.leading);
            network.set_inputs(sample, state, instruction.unwrap_or_default());
        }
        network.submit(gpu, n_samples, |sample, camera| {
            observation.env(first_env + sample).image(mapping.cameras[camera]).0
        })
    }
}
