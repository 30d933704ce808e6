//! Observations that a device computes: those that a [`PolicyPipeline`](crate::policy::PolicyPipeline) has
//! submitted and not yet collected or discarded.

use std::collections::VecDeque;

use crate::nn::gpu::GpuDevice;
use crate::nn::gpu::transfer::BatchInFlight;

/// An observation, in parts that the device can compute at a time.
#[derive(Debug)]
pub(crate) struct ObservationInFlight {
    /// Index of the network.
    pub(crate) network: usize,
    /// Parts in the order of their envs, in which the device computes them.
    pub(crate) parts: Vec<BatchInFlight>,
}

/// Submitted observations, oldest first.
#[derive(Debug, Default)]
pub(crate) struct ObservationsInFlight(VecDeque<ObservationInFlight>);

impl ObservationsInFlight {
    pub(crate) fn push(&mut self, observation: ObservationInFlight) {
        self.0.push_back(observation);
    }

    /// Returns `true` if the oldest observation is complete or has failed, or there is none.
    pub(crate) fn is_ready(&mut self, gpu: &GpuDevice) -> bool {
        let last = self.0.front_mut().and_then(|observation| observation.parts.last_mut());
        last.is_none_or(|part| part.is_ready(gpu))
    }

    /// Takes the oldest observation.
    ///
    /// # Panics
    /// If there is none.
    pub(crate) fn pop(&mut self) -> ObservationInFlight {
        self.0.pop_front().expect("a batch was submitted")
    }
}
