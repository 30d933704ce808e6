//! Submitted commands, and buffers that the host maps when they have completed.

use std::sync::mpsc::{Receiver, channel};

use super::device::{GpuDevice, GpuError};

/// Submitted commands, and the mappings that follow them.
#[derive(Debug)]
pub struct PendingSubmission {
    index: wgpu::SubmissionIndex,
    mapped: Receiver<Result<(), wgpu::BufferAsyncError>>,
    /// Number of mappings that have not completed.
    n_pending: usize,
}

impl PendingSubmission {
    /// Submits commands, and maps the first bytes of each buffer as soon as they have completed.
    pub fn new(
        gpu: &GpuDevice,
        encoder: wgpu::CommandEncoder,
        maps: &[(&wgpu::Buffer, wgpu::MapMode, u64)],
    ) -> Self {
        let index = gpu.queue.submit([encoder.finish()]);
        let (sender, mapped) = channel();
        for (buffer, mode, n_bytes) in maps {
            let sender = sender.clone();
            buffer.map_async(*mode, ..*n_bytes, move |result| {
                // The receiver is gone if the device has failed.
                let _ = sender.send(result);
            });
        }
        Self { index, mapped, n_pending: maps.len() }
    }

    /// Returns `true` if the buffers are mapped or the device has failed.
    pub fn is_ready(&mut self, gpu: &GpuDevice) -> bool {
        gpu.poll();
        self.is_mapped() || gpu.check().is_err()
    }

    /// Waits until the buffers are mapped.
    ///
    /// # Errors
    /// If the device fails.
    pub fn wait(&mut self, gpu: &GpuDevice) -> Result<(), GpuError> {
        gpu.wait(self.index.clone())?;
        if !self.is_mapped() {
            gpu.fail("the results could not be read back");
        }
        gpu.check()
    }

    fn is_mapped(&mut self) -> bool {
        self.n_pending -= self.mapped.try_iter().filter(Result::is_ok).count();
        self.n_pending == 0
    }
}

/// Passes the first bytes of a mapped buffer to `read`, and unmaps it.
///
/// # Errors
/// If the device fails.
pub fn read_mapped(
    gpu: &GpuDevice,
    buffer: &wgpu::Buffer,
    n_bytes: u64,
    read: impl FnOnce(&[u8]),
) -> Result<(), GpuError> {
    match buffer.get_mapped_range(..n_bytes) {
        Ok(bytes) => read(&bytes),
        Err(error) => gpu.fail(&error.to_string()),
    }
    buffer.unmap();
    gpu.check()
}
