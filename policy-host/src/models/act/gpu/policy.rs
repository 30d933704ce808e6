//! ACT networks as a policy on a GPU runs them.

use std::path::Path;
use std::sync::Arc;

use ipc_types::{ImageSizes, Morphology, ObservationView};

use super::network::GpuActNetwork;
use crate::formats::ObservationMapping;
use crate::models::act::checkpoint::{StoredNetwork, load_networks};
use crate::models::act::leading::TokenCache;
use crate::models::{DeviceNetwork, GpuPolicy, LoadGpuError};
use crate::nn::gpu::transfer::BatchInFlight;
use crate::nn::gpu::{GpuDevice, GpuError};
use crate::policy::{ActionChunk, PolicyError};

/// ACT on a device, with one network per morphology in its checkpoint folder.
pub type GpuActPolicy = GpuPolicy<ActDeviceNetwork>;

/// The network for one morphology, with what prepares its inputs.
#[derive(Debug)]
pub struct ActDeviceNetwork {
    model: GpuActNetwork,
    mapping: ObservationMapping,
    ensemble_decay: Option<f64>,
    tokens: TokenCache,
    /// Network state input `[state_dim]` of the current sample.
    state: Vec<f32>,
}

impl GpuActPolicy {
    /// Loads the networks for `robots` in `folder` onto a device, for images of these sizes.
    ///
    /// # Errors
    /// The first file or tensor that is missing, unexpected or damaged, or the failure of the device.
    pub fn load(
        gpu: GpuDevice,
        folder: &Path,
        robots: &[Morphology],
        images: ImageSizes,
    ) -> Result<Self, LoadGpuError> {
        let networks = load_networks(folder, robots, |stored| {
            let model = GpuActNetwork::new(&gpu, &stored, images)?;
            let StoredNetwork { mapping, encoder, ensemble_decay, architecture, .. } = stored;
            let (tokens, state) = (TokenCache::new(encoder), vec![0.0; architecture.state_dim.unwrap_or(0)]);
            Ok::<_, LoadGpuError>(ActDeviceNetwork { model, mapping, ensemble_decay, tokens, state })
        })?;
        Ok(Self::new(networks, Arc::new(gpu)))
    }
}

impl DeviceNetwork for ActDeviceNetwork {
    fn morphology(&self) -> Morphology {
        self.mapping.morphology
    }

    fn capacity(&self) -> usize {
        self.model.capacity()
    }

    fn submit(
        &mut self,
        gpu: &GpuDevice,
        observation: &ObservationView<'_>,
    ) -> Result<Vec<BatchInFlight>, PolicyError> {
        self.mapping.check(observation)?;
        let Self { model, mapping, tokens, state, .. } = self;
        let (n_envs, capacity) = (observation.n_envs(), model.capacity());
        let batches = (0..n_envs).step_by(capacity).map(|first_env| {
            let n_samples = capacity.min(n_envs - first_env);
            for sample in 0..n_samples {
                let env = observation.env(first_env + sample);
                mapping.gather_state(env.state, state);
                let instruction = tokens.get(env.instruction, &model.leading);
                model.set_inputs(sample, state, instruction.unwrap_or_default());
            }
            let image = |sample: usize, camera: usize| {
                observation.env(first_env + sample).image(mapping.cameras[camera]).0
            };
            Ok(model.submit(gpu, n_samples, image)?)
        });
        batches.collect()
    }

    fn collect<'a>(
        &mut self,
        gpu: &GpuDevice,
        batch: BatchInFlight,
        n_rows: &dyn Fn(usize, usize) -> usize,
        _state: &dyn Fn(usize) -> &'a [f32],
        answer: &mut [ActionChunk],
    ) -> Result<(), GpuError> {
        let action_dim = self.model.architecture.action_dim;
        let mut chunks = answer.iter_mut();
        self.model.collect(gpu, batch, |sample, actions| {
            let Some(chunk) = chunks.next() else { return };
            let n_rows = n_rows(sample, actions.len() / action_dim);
            chunk.reset(n_rows, action_dim).copy_from_slice(&actions[..n_rows * action_dim]);
        })
    }

    fn flop_per_query(&self) -> u64 {
        let architecture = &self.model.architecture;
        architecture.flop_per_query(architecture.horizon)
    }

    fn ensemble_decay(&self) -> Option<f64> {
        self.ensemble_decay
    }
}
