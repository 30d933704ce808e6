//! The [`Policy`] that runs ACT networks on a GPU.

use std::path::Path;

use ipc_types::{Morphology, ObservationView};

use super::network::GpuNetwork;
use crate::act::instruction::TokenCache;
use crate::act::policy::ChunkRows;
use crate::act::stored::{StoredNetwork, load_networks};
use crate::checkpoint::{CheckpointFolderError, ObservationMapping};
use crate::nn::gpu::{DeviceKind, GpuDevice, GpuError};
use crate::policy::{ActionChunk, DEFAULT_ENSEMBLE_DECAY, Policy, PolicyError};

/// ACT on a device, with one network per morphology.
#[derive(Debug)]
pub struct GpuActPolicy {
    networks: Vec<DeviceNetwork>,
    rows: ChunkRows,
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

/// Errors that can occur while loading a policy onto a device.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the variants are transparent")]
pub enum LoadGpuError {
    #[error(transparent)]
    Folder(#[from] CheckpointFolderError),
    #[error(transparent)]
    Device(#[from] GpuError),
}

impl GpuActPolicy {
    /// Loads the networks for `robots` in `folder` onto the first adapter of a kind.
    ///
    /// # Errors
    /// The first file or tensor that is missing, unexpected or damaged, or the failure of the device.
    pub fn load(folder: &Path, kind: DeviceKind, robots: &[Morphology]) -> Result<Self, LoadGpuError> {
        let gpu = GpuDevice::open(kind)?;
        let networks = load_networks(folder, robots, |stored| {
            let network = GpuNetwork::new(&gpu, &stored)?;
            let StoredNetwork { mapping, encoder, ensemble_decay, architecture, .. } = stored;
            let (tokens, state) = (TokenCache::new(encoder), vec![0.0; architecture.state_dim.unwrap_or(0)]);
            Ok::<_, LoadGpuError>(DeviceNetwork { gpu: network, mapping, ensemble_decay, tokens, state })
        })?;
        Ok(Self { networks, rows: ChunkRows::Executed, gpu })
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
        assert_eq!(answer.len(), observation.n_envs(), "one chunk per env");
        let morphology = observation.morphology();
        let network = self.networks.iter_mut().find(|network| network.mapping.morphology == morphology);
        let network = network.ok_or(PolicyError::Morphology { found: morphology.name() })?;
        network.mapping.check(observation)?;
        let capacity = network.gpu.capacity();
        for (first_env, chunks) in (0..).step_by(capacity).zip(answer.chunks_mut(capacity)) {
            network
                .run(&self.gpu, (observation, first_env), self.rows, chunks)
                .map_err(|error| PolicyError::Device { message: error.to_string() })?;
        }
        Ok(())
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

impl DeviceNetwork {
    /// Computes the chunks of the envs starting at `first_env`, one per element of `chunks`.
    fn run(
        &mut self,
        gpu: &GpuDevice,
        (observation, first_env): (&ObservationView<'_>, usize),
        rows: ChunkRows,
        chunks: &mut [ActionChunk],
    ) -> Result<(), GpuError> {
        let Self { gpu: network, mapping, tokens, state, .. } = self;
        for sample in 0..chunks.len() {
            let env = observation.env(first_env + sample);
            mapping.gather_state(env.state, state);
            let instruction = tokens.get(env.instruction, &network.leading);
            network.set_inputs(sample, state, instruction.unwrap_or_default());
        }
        let image = |sample: usize, camera: usize| {
            observation.env(first_env + sample).image(mapping.cameras[camera]).0
        };
        let action_dim = network.architecture.action_dim;
        network.forward(gpu, chunks.len(), image, |sample, actions| {
            let execute = observation.env(first_env + sample).record.execute;
            let n_rows = rows.count(execute, actions.len() / action_dim);
            chunks[sample].reset(n_rows, action_dim).copy_from_slice(&actions[..n_rows * action_dim]);
        })
    }
}
