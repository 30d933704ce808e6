//! Device memory.

use bytemuck::{NoUninit, cast_slice};

use super::device::GpuDevice;

/// Minimum size of a buffer in bytes, because bindings must not be empty.
const MIN_BYTES: u64 = 16;

/// An array in device memory, for kernels, uploads and copies.
#[derive(Clone, Debug)]
pub struct DeviceBuffer(pub(crate) wgpu::Buffer);

impl DeviceBuffer {
    /// Allocates `n_words` zeroed 32-bit words.
    #[must_use]
    pub fn zeroed(gpu: &GpuDevice, label: &str, n_words: usize) -> Self {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        Self::create(gpu, label, usage, n_words)
    }

    /// Allocates and uploads an array.
    #[must_use]
    pub fn of<T: NoUninit>(gpu: &GpuDevice, label: &str, values: &[T]) -> Self {
        let buffer = Self::zeroed(gpu, label, size_of_val(values).div_ceil(4));
        buffer.write(gpu, 0, values);
        buffer
    }

    /// Allocates the uniform buffer of the number of units in a batch.
    #[must_use]
    pub fn batch(gpu: &GpuDevice) -> Self {
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        Self::create(gpu, "batch", usage, 4)
    }

    /// Writes values at a byte offset, a multiple of 4, before the next submission.
    pub fn write<T: NoUninit>(&self, gpu: &GpuDevice, offset: u64, values: &[T]) {
        let bytes: &[u8] = cast_slice(values);
        let whole = bytes.len() - bytes.len() % 4;
        gpu.queue.write_buffer(&self.0, offset, &bytes[..whole]);
        if whole < bytes.len() {
            let mut last = [0; 4];
            last[..bytes.len() - whole].copy_from_slice(&bytes[whole..]);
            gpu.queue.write_buffer(&self.0, offset + whole as u64, &last);
        }
    }

    fn create(gpu: &GpuDevice, label: &str, usage: wgpu::BufferUsages, n_words: usize) -> Self {
        Self(gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: (n_words as u64 * 4).max(MIN_BYTES),
            usage,
            mapped_at_creation: false,
        }))
    }
}
