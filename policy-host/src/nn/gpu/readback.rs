//! Submission of a batch, and the way of its result back to the host.

use std::sync::mpsc::{Receiver, sync_channel};

use super::buffer::DeviceBuffer;
use super::device::{GpuDevice, GpuError};
use super::kernel::Dispatch;

/// A step of a batch.
#[derive(Debug)]
pub enum NetworkStep {
    /// A kernel.
    Run(Dispatch),
    /// A copy of `n_words` words to each sample's part of a buffer.
    Copy {
        /// Source and its words from one sample to the next: 0 if all samples get the same.
        from: (DeviceBuffer, usize),
        /// Target and its words from one sample to the next.
        to: (DeviceBuffer, usize),
        /// Words per sample.
        n_words: usize,
    },
}

/// A host-readable buffer for the result of a batch.
#[derive(Debug)]
pub struct BatchReadback {
    buffer: wgpu::Buffer,
}

/// A submitted batch.
#[derive(Debug)]
pub struct SubmittedBatch {
    submission: wgpu::SubmissionIndex,
    mapped: Receiver<Result<(), wgpu::BufferAsyncError>>,
    n_bytes: u64,
}

impl NetworkStep {
    /// Returns the largest number of samples that the step can take at a time.
    #[must_use]
    pub fn max_samples(&self) -> usize {
        match self {
            Self::Run(dispatch) => dispatch.max_samples(),
            Self::Copy { .. } => usize::MAX,
        }
    }
}

impl BatchReadback {
    /// Allocates a buffer for `n_words` words.
    #[must_use]
    pub fn new(gpu: &GpuDevice, n_words: usize) -> Self {
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("readback"),
            size: n_words as u64 * 4,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        Self { buffer }
    }

    /// Submits the steps for `n_samples` samples, then copies the first `n_words` words of `result` here.
    #[must_use]
    pub fn submit(
        &self,
        gpu: &GpuDevice,
        steps: &[NetworkStep],
        n_samples: usize,
        (result, n_words): (&DeviceBuffer, usize),
    ) -> SubmittedBatch {
        let n_bytes = n_words as u64 * 4;
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encode(&mut encoder, steps, n_samples);
        encoder.copy_buffer_to_buffer(&result.0, 0, &self.buffer, 0, Some(n_bytes));
        let submission = gpu.queue.submit([encoder.finish()]);
        let (sender, mapped) = sync_channel(1);
        self.buffer.map_async(wgpu::MapMode::Read, ..n_bytes, move |result| {
            // The receiver is gone if the batch has failed.
            let _ = sender.send(result);
        });
        SubmittedBatch { submission, mapped, n_bytes }
    }

    /// Waits for a submitted batch and passes its result to `read`.
    ///
    /// # Errors
    /// If the device fails.
    pub fn collect(
        &self,
        gpu: &GpuDevice,
        pending: &SubmittedBatch,
        read: impl FnOnce(&[f32]),
    ) -> Result<(), GpuError> {
        gpu.wait(pending.submission.clone())?;
        if !matches!(pending.mapped.try_recv(), Ok(Ok(()))) {
            gpu.fail("the actions could not be read back");
        }
        gpu.check()?;
        match self.buffer.get_mapped_range(..pending.n_bytes) {
            Ok(bytes) => read(bytemuck::cast_slice(&bytes)),
            Err(error) => gpu.fail(&error.to_string()),
        }
        self.buffer.unmap();
        gpu.check()
    }
}

/// Submits the steps for `n_samples` samples without a result.
///
/// # Errors
/// If the device fails.
pub fn run(gpu: &GpuDevice, steps: &[NetworkStep], n_samples: usize) -> Result<(), GpuError> {
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encode(&mut encoder, steps, n_samples);
    let submission = gpu.queue.submit([encoder.finish()]);
    gpu.wait(submission)
}

/// Submits runs of steps, each for its own number of units of the batch, without a result. Does not wait.
pub fn submit_runs<'a>(gpu: &GpuDevice, runs: impl IntoIterator<Item = (usize, &'a [NetworkStep])>) {
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    for (n_units, steps) in runs {
        encode(&mut encoder, steps, n_units);
    }
    gpu.queue.submit([encoder.finish()]);
}

pub(super) fn encode(encoder: &mut wgpu::CommandEncoder, steps: &[NetworkStep], n_samples: usize) {
    for run in steps.chunk_by(|a, b| matches!((a, b), (NetworkStep::Run(_), NetworkStep::Run(_)))) {
        if let NetworkStep::Copy { from, to, n_words } = &run[0] {
            for sample in 0..n_samples {
                let offset = |stride: usize| (sample * stride * 4) as u64;
                let n_bytes = Some(*n_words as u64 * 4);
                encoder.copy_buffer_to_buffer(&from.0.0, offset(from.1), &to.0.0, offset(to.1), n_bytes);
            }
            continue;
        }
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        for step in run {
            if let NetworkStep::Run(dispatch) = step {
                dispatch.encode(&mut pass, n_samples);
            }
        }
    }
}
