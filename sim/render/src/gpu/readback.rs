//! Asynchronous readback of rendered images.

use gpu::{GpuDevice, GpuError, PendingSubmission, read_mapped};
use ipc_types::RGB_BYTES;
use rayon::prelude::*;

use super::chunk::size::{n_device_pixels, whole_tiles};
use crate::View;

/// A CPU-readable buffer. Two of them alternate between chunks.
pub(crate) struct Readback {
    buffer: Option<wgpu::Buffer>,
    /// Size of the images of the largest chunk in bytes.
    full_size: u64,
    /// The submission that has not been collected yet.
    pending: Option<Pending>,
    /// Start of each image in the buffer.
    offsets: Vec<usize>,
}

struct Pending {
    submission: PendingSubmission,
    n_bytes: u64,
}

impl Readback {
    /// Creates a readback without a buffer. The images of the largest chunk have `full_size` bytes.
    pub(crate) fn new(full_size: u64) -> Self {
        Self { buffer: None, full_size, pending: None, offsets: Vec::new() }
    }

    /// Returns the size of the buffer in bytes.
    pub(crate) fn n_bytes(&self) -> u64 {
        self.buffer.as_ref().map_or(0, wgpu::Buffer::size)
    }

    /// Submits commands that render `n_bytes` of images into `images`, followed by their copy to the readback
    /// buffer.
    pub(crate) fn submit(
        &mut self,
        gpu: &GpuDevice,
        mut encoder: wgpu::CommandEncoder,
        images: &wgpu::Buffer,
        n_bytes: u64,
    ) {
        let buffer = self.reserve(gpu, n_bytes);
        encoder.copy_buffer_to_buffer(images, 0, &buffer, 0, Some(n_bytes));
        let maps = [(&buffer, wgpu::MapMode::Read, n_bytes)];
        let submission = PendingSubmission::new(gpu, encoder, &maps);
        self.pending = Some(Pending { submission, n_bytes });
    }

    /// Waits until the pending submission has completed.
    ///
    /// # Errors
    /// If the device fails.
    pub(crate) fn wait(&mut self, gpu: &GpuDevice) -> Result<(), GpuError> {
        self.pending.as_mut().map_or(Ok(()), |pending| pending.submission.wait(gpu))
    }

    /// Copies the images of the completed submission into its views, on the current rayon pool.
    ///
    /// # Errors
    /// If the buffer cannot be read.
    pub(crate) fn collect(&mut self, gpu: &GpuDevice, views: &mut [View<'_>]) -> Result<(), GpuError> {
        let (Some(pending), Some(buffer)) = (self.pending.take(), &self.buffer) else { return Ok(()) };
        self.offsets.clear();
        let mut end = 0;
        self.offsets.extend(views.iter().map(|view| {
            let start = end;
            end += n_device_pixels(view) as usize * RGB_BYTES;
            start
        }));
        read_mapped(gpu, buffer, pending.n_bytes, |bytes| {
            views.par_iter_mut().zip(&self.offsets).for_each(|(view, offset)| {
                copy_image(&bytes[*offset..], view);
            });
        })
    }

    fn reserve(&mut self, gpu: &GpuDevice, n_bytes: u64) -> wgpu::Buffer {
        let large_enough = self.buffer.take().filter(|buffer| buffer.size() >= n_bytes);
        let buffer = large_enough.unwrap_or_else(|| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("readback"),
                size: n_bytes.next_power_of_two().min(self.full_size).max(n_bytes),
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                mapped_at_creation: false,
            })
        });
        self.buffer.insert(buffer).clone()
    }
}

/// Copies an image out of its tiles.
fn copy_image(tiles: &[u8], view: &mut View<'_>) {
    let width = view.scene.size(view.camera_idx).width;
    let [pitch, _] = whole_tiles(view.scene.size(view.camera_idx));
    if pitch as usize == width {
        view.out.copy_from_slice(&tiles[..view.out.len()]);
        return;
    }
    let rows = view.out.chunks_exact_mut(width * RGB_BYTES);
    for (row, tiles) in rows.zip(tiles.chunks_exact(pitch as usize * RGB_BYTES)) {
        row.copy_from_slice(&tiles[..row.len()]);
    }
}
