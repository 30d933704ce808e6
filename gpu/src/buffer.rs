//! Device memory.

use bytemuck::{NoUninit, cast_slice};

use super::device::GpuDevice;

/// Minimum size of a buffer in bytes, because bindings must not be empty and hold at least one record.
const MIN_BYTES: u64 = 256;

/// An array in device memory, for kernels, uploads and copies.
#[derive(Clone, Debug)]
pub struct DeviceBuffer(pub wgpu::Buffer);

/// A buffer that is replaced by a larger one when it is too small. Sizes are powers of two, within the
/// device's limit and the size that suffices for everything. Growing discards the contents.
pub struct GrowableBuffer {
    label: &'static str,
    full_size: u64,
    buffer: DeviceBuffer,
}

impl DeviceBuffer {
    const STORAGE: wgpu::BufferUsages =
        wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_DST).union(wgpu::BufferUsages::COPY_SRC);

    /// Allocates `n_words` zeroed 32-bit words.
    #[must_use]
    pub fn zeroed(gpu: &GpuDevice, label: &str, n_words: usize) -> Self {
        Self::create(gpu, label, Self::STORAGE, n_words as u64 * 4)
    }

    /// Allocates and uploads an array.
    #[must_use]
    pub fn of<T: NoUninit>(gpu: &GpuDevice, label: &str, values: &[T]) -> Self {
        let buffer = Self::zeroed(gpu, label, size_of_val(values).div_ceil(4));
        buffer.write(gpu, 0, values);
        buffer
    }

    /// Allocates the smallest uniform buffer.
    #[must_use]
    pub fn uniform(gpu: &GpuDevice, label: &str) -> Self {
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        Self::create(gpu, label, usage, 0)
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

    fn create(gpu: &GpuDevice, label: &str, usage: wgpu::BufferUsages, n_bytes: u64) -> Self {
        Self(gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: n_bytes.max(MIN_BYTES),
            usage,
            mapped_at_creation: false,
        }))
    }
}

impl GrowableBuffer {
    /// Creates a minimal buffer, which grows up to `full_size` bytes.
    #[must_use]
    pub fn new(gpu: &GpuDevice, label: &'static str, full_size: u64) -> Self {
        Self { label, full_size, buffer: DeviceBuffer::zeroed(gpu, label, 0) }
    }

    /// Returns the buffer as it is now.
    #[must_use]
    pub fn buffer(&self) -> &wgpu::Buffer {
        &self.buffer.0
    }

    /// Ensures a capacity of `n_bytes`. Returns `true` if the buffer was reallocated.
    pub fn reserve(&mut self, gpu: &GpuDevice, n_bytes: u64) -> bool {
        if n_bytes <= self.buffer().size() {
            return false;
        }
        let limit = self.full_size.min(gpu.max_buffer_bytes());
        let size = n_bytes.next_power_of_two().min(limit).max(n_bytes);
        self.buffer = DeviceBuffer::create(gpu, self.label, DeviceBuffer::STORAGE, size);
        true
    }

    /// Writes `items` at an index, for which there must be room.
    pub fn write_at<T: NoUninit>(&self, gpu: &GpuDevice, items: &[T], first: usize) {
        self.buffer.write(gpu, (first * size_of::<T>()) as u64, items);
    }

    /// Writes all `items`, of which the first `n_written` are already in the buffer unless it has to be
    /// reallocated. Returns `true` if it was.
    pub fn append<T: NoUninit>(&mut self, gpu: &GpuDevice, items: &[T], n_written: usize) -> bool {
        let reallocated = self.reserve(gpu, size_of_val(items) as u64);
        let first = if reallocated { 0 } else { n_written };
        self.write_at(gpu, &items[first..], first);
        reallocated
    }
}
