//! The [`Policy`] that runs a family's networks on a GPU.

use std::collections::VecDeque;
use std::sync::Arc;

use ipc_types::{Morphology, ObservationView};
use thiserror::Error;

use crate::formats::CheckpointFolderError;
use crate::nn::gpu::transfer::BatchInFlight;
use crate::nn::gpu::{GpuDevice, GpuError};
use crate::policy::{ActionChunk, ChunkRows, DEFAULT_ENSEMBLE_DECAY, Policy, PolicyError, PolicyPipeline};

/// Errors that can occur while loading a policy onto a device.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the variants are transparent")]
pub enum LoadGpuError {
    #[error(transparent)]
    Folder(#[from] CheckpointFolderError),
    #[error(transparent)]
    Device(#[from] GpuError),
}

/// The network of one robot on a device.
pub trait DeviceNetwork: Send {
    /// Returns the robot that the network controls.
    fn morphology(&self) -> Morphology;

    /// Returns the largest number of envs in a batch.
    fn capacity(&self) -> usize;

    /// Starts computing the chunks of an observation, in batches of up to [`capacity`](Self::capacity) envs.
    ///
    /// # Errors
    /// If the network cannot act on the observation, in which case no batch was submitted, or the device
    /// fails.
    fn submit(
        &mut self,
        gpu: &GpuDevice,
        observation: &ObservationView<'_>,
    ) -> Result<Vec<BatchInFlight>, PolicyError>;

    /// Waits for a batch and writes a chunk into each element of `answer`, of as many rows as
    /// `n_rows(env, horizon)` returns, or more. `state(env)` is the robot's state in the observation.
    ///
    /// # Errors
    /// If the device fails.
    fn collect<'a>(
        &mut self,
        gpu: &GpuDevice,
        batch: BatchInFlight,
        n_rows: &dyn Fn(usize, usize) -> usize,
        state: &dyn Fn(usize) -> &'a [f32],
        answer: &mut [ActionChunk],
    ) -> Result<(), GpuError>;

    /// Returns the floating-point operations of a query.
    fn flop_per_query(&self) -> u64;

    /// Returns the decay of the temporal ensemble's weights, if the checkpoint specifies one.
    fn ensemble_decay(&self) -> Option<f64> {
        None
    }

    /// Returns a description for the user.
    fn startup_message(&self) -> Option<String> {
        None
    }
}

/// A policy on a device, with one network per morphology in its checkpoint folder.
#[derive(Debug)]
pub struct GpuPolicy<N> {
    networks: Vec<N>,
    rows: ChunkRows,
    /// Submitted observations, oldest first: the index of the network, and the batches in the order of their
    /// envs, in which the device computes them.
    in_flight: VecDeque<(usize, Vec<BatchInFlight>)>,
    gpu: Arc<GpuDevice>,
}

impl<N: DeviceNetwork> GpuPolicy<N> {
    /// Creates a policy with these networks.
    pub(crate) fn new(networks: Vec<N>, gpu: Arc<GpuDevice>) -> Self {
        Self { networks, rows: ChunkRows::Executed, in_flight: VecDeque::new(), gpu }
    }

    fn network(&self, morphology: Morphology) -> Option<&N> {
        self.networks.iter().find(|network| network.morphology() == morphology)
    }

    /// Takes the oldest observation.
    fn oldest(&mut self) -> (usize, Vec<BatchInFlight>) {
        self.in_flight.pop_front().expect("a batch was submitted")
    }
}

impl<N: DeviceNetwork> Policy for GpuPolicy<N> {
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

    fn startup_message(&self, _execute: u32, _flop_per_s: f64) -> Option<String> {
        let notes: Vec<String> = self.networks.iter().filter_map(DeviceNetwork::startup_message).collect();
        (!notes.is_empty()).then(|| notes.join("; "))
    }

    fn flop_per_query(&self, morphology: Morphology, _execute: u32) -> u64 {
        self.network(morphology).map_or(0, DeviceNetwork::flop_per_query)
    }

    fn ensemble_decay(&self, morphology: Morphology) -> f64 {
        self.network(morphology).and_then(DeviceNetwork::ensemble_decay).unwrap_or(DEFAULT_ENSEMBLE_DECAY)
    }
}

impl<N: DeviceNetwork> PolicyPipeline for GpuPolicy<N> {
    fn submit(&mut self, observation: &ObservationView<'_>) -> Result<(), PolicyError> {
        let morphology = observation.morphology();
        let index = self.networks.iter().position(|network| network.morphology() == morphology);
        let index = index.ok_or(PolicyError::Morphology { found: morphology.name() })?;
        let batches = self.networks[index].submit(&self.gpu, observation)?;
        self.in_flight.push_back((index, batches));
        Ok(())
    }

    fn is_ready(&mut self) -> bool {
        let last = self.in_flight.front_mut().and_then(|(_, batches)| batches.last_mut());
        last.is_none_or(|batch| batch.is_ready(&self.gpu))
    }

    fn collect(
        &mut self,
        observation: &ObservationView<'_>,
        answer: &mut [ActionChunk],
    ) -> Result<(), PolicyError> {
        assert_eq!(answer.len(), observation.n_envs(), "one chunk per env");
        let (index, batches) = self.oldest();
        let Self { networks, rows, gpu, .. } = self;
        let capacity = networks[index].capacity();
        let parts = batches.into_iter().zip(answer.chunks_mut(capacity));
        for ((batch, answer), first_env) in parts.zip((0..).step_by(capacity)) {
            let n_rows = |env, horizon| rows.count(observation.env(first_env + env).record.execute, horizon);
            let state = |env| observation.env(first_env + env).state;
            networks[index].collect(gpu, batch, &n_rows, &state, answer)?;
        }
        Ok(())
    }

    fn discard(&mut self) -> Result<(), PolicyError> {
        let (index, batches) = self.oldest();
        for batch in batches {
            self.networks[index].collect(&self.gpu, batch, &|_, horizon| horizon, &|_| &[], &mut [])?;
        }
        Ok(())
    }
}
