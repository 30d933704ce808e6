//! Growable device buffers.

use super::device::Gpu;

/// Minimum size of a buffer in bytes, because bindings must not be empty.
const MIN_BYTES: u64 = 256;

/// A storage buffer that is replaced by a larger one when it is too small. Sizes are powers of two, within
/// the device's limit. Growing discards the contents.
pub(super) struct GrowableBuffer {
    label: &'static str,
    usage: wgpu::BufferUsages,
    pub(super) buffer: wgpu::Buffer,
}

impl GrowableBuffer {
    /// Creates a minimal storage buffer that the queue can write, with additional `usage` flags.
    pub(super) fn new(gpu: &Gpu, label: &'static str, usage: wgpu::BufferUsages) -> Self {
        let usage = usage | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::STORAGE;
        Self { label, usage, buffer: create(gpu, label, usage, MIN_BYTES) }
    }

    /// Ensures a capacity of `n_bytes`. Returns `true` if the buffer was reallocated.
    pub(super) fn reserve(&mut self, gpu: &Gpu, n_bytes: u64) -> bool {
        if n_bytes <= self.buffer.size() {
            return false;
        }
        let size = n_bytes.next_power_of_two().min(gpu.max_buffer_bytes).max(n_bytes);
        self.buffer = create(gpu, self.label, self.usage, size);
        true
    }

    /// Writes `items` at the start of the buffer. Returns `true` if the buffer was reallocated.
    pub(super) fn write<T: bytemuck::NoUninit>(&mut self, gpu: &Gpu, items: &[T]) -> bool {
        let bytes = bytemuck::cast_slice(items);
        let reallocated = self.reserve(gpu, bytes.len() as u64);
        gpu.queue.write_buffer(&self.buffer, 0, bytes);
        reallocated
    }

    /// Writes all `items`, of which the first `n_written` are already in the buffer unless it has to be
    /// reallocated. Returns `true` if it was.
    pub(super) fn append<T: bytemuck::NoUninit>(&mut self, gpu: &Gpu, items: &[T], n_written: usize) -> bool {
        let reallocated = self.reserve(gpu, size_of_val(items) as u64);
        let first = if reallocated { 0 } else { n_written };
        let offset = (first * size_of::<T>()) as u64;
        gpu.queue.write_buffer(&self.buffer, offset, bytemuck::cast_slice(&items[first..]));
        reallocated
    }
}

fn create(gpu: &Gpu, label: &'static str, usage: wgpu::BufferUsages, size: u64) -> wgpu::Buffer {
    let label = Some(label);
    gpu.device.create_buffer(&wgpu::BufferDescriptor { label, size, usage, mapped_at_creation: false })
}
