//! Steps of a network, and their encoding for a batch.

use gpu::{DeviceBuffer, GpuDevice, GpuError};

use super::kernel::Dispatch;

/// A step of a batch.
#[derive(Debug)]
pub enum NetworkStep {
    /// A kernel.
    Run(Dispatch),
    /// A copy of `n_words` words to each unit's part of a buffer.
    Copy {
        /// Source and its words from one unit to the next: 0 if all units get the same.
        from: (DeviceBuffer, usize),
        /// Target and its words from one unit to the next.
        to: (DeviceBuffer, usize),
        /// Words per unit.
        n_words: usize,
    },
}

/// Successive steps for the same units of a batch: its samples, for example, or all rows of its sequences.
#[derive(Debug)]
pub struct StepRun {
    /// Index of the unit among those that a batch counts.
    pub unit: usize,
    /// Steps in their order.
    pub steps: Vec<NetworkStep>,
}

impl NetworkStep {
    fn max_units(&self) -> usize {
        match self {
            Self::Run(dispatch) => dispatch.max_samples(),
            Self::Copy { .. } => usize::MAX,
        }
    }
}

impl StepRun {
    /// Returns the largest number of units that the run can take at a time.
    #[must_use]
    pub fn max_units(&self) -> usize {
        self.steps.iter().map(NetworkStep::max_units).fold(usize::MAX, usize::min)
    }
}

/// Submits the steps for `n_units` units without inputs and results, and waits.
///
/// # Errors
/// If the device fails.
pub fn run(gpu: &GpuDevice, steps: &[NetworkStep], n_units: usize) -> Result<(), GpuError> {
    let mut encoder = gpu.encoder();
    encode(&mut encoder, steps, n_units);
    let submission = gpu.queue.submit([encoder.finish()]);
    gpu.wait(submission)
}

pub(crate) fn encode(encoder: &mut wgpu::CommandEncoder, steps: &[NetworkStep], n_units: usize) {
    for run in steps.chunk_by(|a, b| matches!((a, b), (NetworkStep::Run(_), NetworkStep::Run(_)))) {
        if let NetworkStep::Copy { from, to, n_words } = &run[0] {
            for unit in 0..n_units {
                let offset = |stride: usize| (unit * stride * 4) as u64;
                let n_bytes = Some(*n_words as u64 * 4);
                encoder.copy_buffer_to_buffer(&from.0.0, offset(from.1), &to.0.0, offset(to.1), n_bytes);
            }
            continue;
        }
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        for step in run {
            if let NetworkStep::Run(dispatch) = step {
                dispatch.encode(&mut pass, n_units);
            }
        }
    }
}
