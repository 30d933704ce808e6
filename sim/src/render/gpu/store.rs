//! A buffer on the device that grows.

use super::device::Gpu;

/// Least size of a buffer in bytes: a binding is never empty.
const LEAST: u64 = 256;

/// A buffer that is exchanged for one of twice the size or more when it is too small; what it held is then lost.
pub(super) struct Store {
    label: &'static str,
    usage: wgpu::BufferUsages,
    pub(super) buffer: wgpu::Buffer,
}

impl Store {
    /// A small one, written by the queue and used for storage, and `usage` on top.
    pub(super) fn new(gpu: &Gpu, label: &'static str, usage: wgpu::BufferUsages) -> Self {
        let usage = usage | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::STORAGE;
        Self { label, usage, buffer: create(gpu, label, usage, LEAST) }
    }

    /// Makes room; whether that took another buffer.
    pub(super) fn fit(&mut self, gpu: &Gpu, bytes: u64) -> bool {
        if bytes <= self.buffer.size() {
            return false;
        }
        self.buffer = create(gpu, self.label, self.usage, bytes.next_power_of_two());
        true
    }

    /// Writes from the start on; whether that took another buffer.
    pub(super) fn write<T: bytemuck::NoUninit>(&mut self, gpu: &Gpu, items: &[T]) -> bool {
        let bytes = bytemuck::cast_slice(items);
        let grown = self.fit(gpu, bytes.len() as u64);
        gpu.queue.write_buffer(&self.buffer, 0, bytes);
        grown
    }
}

fn create(gpu: &Gpu, label: &'static str, usage: wgpu::BufferUsages, size: u64) -> wgpu::Buffer {
    let label = Some(label);
    gpu.device.create_buffer(&wgpu::BufferDescriptor { label, size, usage, mapped_at_creation: false })
}
