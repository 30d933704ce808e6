//! Growable device buffers.

use super::device::Gpu;

/// Minimum size of a buffer in bytes, because bindings must not be empty.
const MIN_BYTES: u64 = 256;

/// A storage buffer that is replaced by a larger one when it is too small. Sizes are powers of two, within
/// the device's limit and the size for the largest chunk. Growing discards the contents.
pub(crate) struct GrowableBuffer {
    label: &'static str,
    usage: wgpu::BufferUsages,
    /// Size that suffices for the largest chunk.
    full_size: u64,
    pub(crate) buffer: wgpu::Buffer,
}

impl GrowableBuffer {
    /// Creates a minimal storage buffer that the queue can write, with additional `usage` flags.
    pub(crate) fn new(gpu: &Gpu, label: &'static str, usage: wgpu::BufferUsages) -> Self {
        let usage = usage | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::STORAGE;
        Self { label, usage, full_size: gpu.max_buffer_bytes, buffer: create(gpu, label, usage, MIN_BYTES) }
    }

    /// Limits growth to a size that suffices for the largest chunk.
    pub(crate) fn with_full_size(self, full_size: u64) -> Self {
        Self { full_size, ..self }
    }

    /// Ensures a capacity of `n_bytes`. Returns `true` if the buffer was reallocated.
    pub(crate) fn reserve(&mut self, gpu: &Gpu, n_bytes: u64) -> bool {
        if n_bytes <= self.buffer.size() {
            return false;
        }
        let size = n_bytes.next_power_of_two().min(self.full_size).min(gpu.max_buffer_bytes).max(n_bytes);
        self.buffer = create(gpu, self.label, self.usage, size);
        true
    }

    /// Writes `items` at the start of the buffer. Returns `true` if the buffer was reallocated.
    pub(crate) fn write<T: bytemuck::NoUninit>(&mut self, gpu: &Gpu, items: &[T]) -> bool {
        let reallocated = self.reserve(gpu, size_of_val(items) as u64);
        self.write_at(gpu, items, 0);
        reallocated
    }

    /// Writes `items` at an index, for which there must be room.
    pub(crate) fn write_at<T: bytemuck::NoUninit>(&self, gpu: &Gpu, items: &[T], first: usize) {
        gpu.queue.write_buffer(&self.buffer, (first * size_of::<T>()) as u64, bytemuck::cast_slice(items));
    }

    /// Writes all `items`, of which the first `n_written` are already in the buffer unless it has to be
    /// reallocated. Returns `true` if it was.
    pub(crate) fn append<T: bytemuck::NoUninit>(&mut self, gpu: &Gpu, items: &[T], n_written: usize) -> bool {
        let reallocated = self.reserve(gpu, size_of_val(items) as u64);
        let first = if reallocated { 0 } else { n_written };
        self.write_at(gpu, &items[first..], first);
        reallocated
    }
}

fn create(gpu: &Gpu, label: &'static str, usage: wgpu::BufferUsages, size: u64) -> wgpu::Buffer {
    let label = Some(label);
    gpu.device.create_buffer(&wgpu::BufferDescriptor { label, size, usage, mapped_at_creation: false })
}
