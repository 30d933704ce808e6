//! Batches in flight: inputs on their way to the device, results on their way back.
//!
//! Inputs are written once, into host-visible memory, from which the device copies them before the first step
//! of their batch. Each batch in flight has such memory of its own, which is reused after it.

use std::sync::mpsc::{Receiver, Sender, channel};

use rayon::prelude::*;

use super::buffer::DeviceBuffer;
use super::device::{GpuDevice, GpuError};
use super::readback::{NetworkStep, encode};

/// Alignment of mapped ranges in bytes.
const ALIGNMENT: u64 = wgpu::MAP_ALIGNMENT;
/// Bytes before the inputs, for the number of samples.
const HEADER_BYTES: u64 = 16;

/// An input of a network.
#[derive(Clone, Debug)]
pub struct BatchInput {
    /// Memory of all samples.
    pub target: DeviceBuffer,
    /// Words of a sample.
    pub n_words: usize,
}

/// The way of a network's batches to the device and back.
#[derive(Debug)]
pub struct BatchQueue {
    inputs: Vec<BatchInput>,
    n_samples: DeviceBuffer,
    result: BatchInput,
    capacity: usize,
    /// Memory that no batch uses.
    idle: Vec<TransferBuffers>,
}

/// Host-visible memory of one batch.
#[derive(Debug)]
struct TransferBuffers {
    /// Mapped while no batch uses it.
    upload: wgpu::Buffer,
    download: wgpu::Buffer,
}

/// A submitted batch.
#[derive(Debug)]
pub struct BatchInFlight {
    submission: wgpu::SubmissionIndex,
    buffers: TransferBuffers,
    /// Completed mappings of the two buffers.
    mapped: Receiver<Result<(), wgpu::BufferAsyncError>>,
    n_mapped: usize,
    n_samples: usize,
}

impl BatchQueue {
    /// Prepares batches of up to `capacity` samples with these inputs. `n_samples` is the uniform buffer of
    /// their number, `result` what is read back.
    #[must_use]
    pub fn new(
        inputs: Vec<BatchInput>,
        n_samples: DeviceBuffer,
        result: BatchInput,
        capacity: usize,
    ) -> Self {
        Self { inputs, n_samples, result, capacity, idle: Vec::new() }
    }

    /// Returns the host-visible memory of a batch in flight, in bytes.
    #[must_use]
    pub fn n_bytes(&self) -> u64 {
        self.upload_bytes() + self.result_bytes(self.capacity)
    }

    /// Uploads a batch and submits its steps. `bytes(input, sample)` returns what is written at the start of
    /// the sample's memory. The threads of the current rayon pool share the copying.
    ///
    /// # Errors
    /// If the device fails.
    ///
    /// # Panics
    /// If there are more samples than the capacity, or more bytes than a sample's memory holds.
    pub fn submit<'b>(
        &mut self,
        gpu: &GpuDevice,
        steps: &[NetworkStep],
        n_samples: usize,
        bytes: &(dyn Fn(usize, usize) -> &'b [u8] + Sync),
    ) -> Result<BatchInFlight, GpuError> {
        assert!((1..=self.capacity).contains(&n_samples), "{n_samples} samples, at most {}", self.capacity);
        let buffers = self.idle.pop().unwrap_or_else(|| self.allocate(gpu));
        self.write(gpu, &buffers.upload, n_samples, bytes)?;
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let (upload, download) = (&buffers.upload, &buffers.download);
        encoder.copy_buffer_to_buffer(upload, 0, &self.n_samples.0, 0, Some(4));
        for (input, offset) in self.inputs.iter().zip(self.offsets()) {
            let n_bytes = (n_samples * input.n_words * 4) as u64;
            encoder.copy_buffer_to_buffer(upload, offset, &input.target.0, 0, Some(n_bytes));
        }
        encode(&mut encoder, steps, n_samples);
        let n_bytes = self.result_bytes(n_samples);
        encoder.copy_buffer_to_buffer(&self.result.target.0, 0, download, 0, Some(n_bytes));
        let submission = gpu.queue.submit([encoder.finish()]);
        let (sender, mapped) = channel();
        upload.map_async(wgpu::MapMode::Write, .., report(&sender));
        download.map_async(wgpu::MapMode::Read, ..n_bytes, report(&sender));
        gpu.check()?;
        Ok(BatchInFlight { submission, buffers, mapped, n_mapped: 0, n_samples })
    }

    /// Waits for a batch, passes its result to `read`, and takes back its memory.
    ///
    /// # Errors
    /// If the device fails.
    pub fn collect(
        &mut self,
        gpu: &GpuDevice,
        mut batch: BatchInFlight,
        read: impl FnOnce(&[f32]),
    ) -> Result<(), GpuError> {
        gpu.wait(batch.submission.clone())?;
        if !batch.is_mapped() {
            gpu.fail("the result of a batch could not be read back");
        }
        gpu.check()?;
        let download = &batch.buffers.download;
        match download.get_mapped_range(..self.result_bytes(batch.n_samples)) {
            Ok(bytes) => read(bytemuck::cast_slice(&bytes)),
            Err(error) => gpu.fail(&error.to_string()),
        }
        download.unmap();
        gpu.check()?;
        self.idle.push(batch.buffers);
        Ok(())
    }

    /// Writes the inputs of a batch into mapped memory.
    fn write<'b>(
        &self,
        gpu: &GpuDevice,
        upload: &wgpu::Buffer,
        n_samples: usize,
        bytes: &(dyn Fn(usize, usize) -> &'b [u8] + Sync),
    ) -> Result<(), GpuError> {
        let put = |offset: u64, n_bytes: u64, bytes: &[u8]| match upload
            .get_mapped_range_mut(offset..offset + n_bytes.next_multiple_of(4))
        {
            Ok(mut mapped) => mapped.slice(..bytes.len()).copy_from_slice(bytes),
            Err(error) => gpu.fail(&error.to_string()),
        };
        put(0, HEADER_BYTES, &(n_samples as u32).to_le_bytes());
        for ((index, input), offset) in self.inputs.iter().enumerate().zip(self.offsets()) {
            let stride = (input.n_words * 4) as u64;
            let put_sample = |sample: usize| {
                let bytes = bytes(index, sample);
                assert!(bytes.len() as u64 <= stride, "{} bytes, at most {stride}", bytes.len());
                put(offset + sample as u64 * stride, bytes.len() as u64, bytes);
            };
            if stride.is_multiple_of(ALIGNMENT) {
                (0..n_samples).into_par_iter().for_each(put_sample);
            } else {
                self.put_unaligned(gpu, upload, (offset, stride), n_samples, &|sample| bytes(index, sample));
            }
        }
        upload.unmap();
        gpu.check()
    }

    /// Writes an input whose samples do not begin at mappable offsets.
    fn put_unaligned<'b>(
        &self,
        gpu: &GpuDevice,
        upload: &wgpu::Buffer,
        (offset, stride): (u64, u64),
        n_samples: usize,
        bytes: &dyn Fn(usize) -> &'b [u8],
    ) {
        match upload.get_mapped_range_mut(offset..offset + stride * n_samples as u64) {
            Ok(mut mapped) => {
                for sample in 0..n_samples {
                    let (bytes, first) = (bytes(sample), sample * stride as usize);
                    mapped.slice(first..first + bytes.len()).copy_from_slice(bytes);
                }
            }
            Err(error) => gpu.fail(&error.to_string()),
        }
    }

    /// Returns the offset of each input in the upload memory.
    fn offsets(&self) -> impl Iterator<Item = u64> {
        self.inputs.iter().scan(HEADER_BYTES, |next, input| {
            let offset = *next;
            *next += ((self.capacity * input.n_words * 4) as u64).next_multiple_of(ALIGNMENT);
            Some(offset)
        })
    }

    fn upload_bytes(&self) -> u64 {
        let input_bytes = |input: &BatchInput| (self.capacity * input.n_words * 4) as u64;
        let inputs = self.inputs.iter().map(|input| input_bytes(input).next_multiple_of(ALIGNMENT));
        HEADER_BYTES + inputs.sum::<u64>()
    }

    fn result_bytes(&self, n_samples: usize) -> u64 {
        (n_samples * self.result.n_words * 4) as u64
    }

    fn allocate(&self, gpu: &GpuDevice) -> TransferBuffers {
        let create = |label, size, usage, mapped_at_creation| {
            let descriptor = wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation };
            gpu.device.create_buffer(&descriptor)
        };
        let [from, to] = [wgpu::BufferUsages::COPY_SRC, wgpu::BufferUsages::COPY_DST];
        TransferBuffers {
            upload: create("upload", self.upload_bytes(), from | wgpu::BufferUsages::MAP_WRITE, true),
            download: create(
                "download",
                self.result_bytes(self.capacity),
                to | wgpu::BufferUsages::MAP_READ,
                false,
            ),
        }
    }
}

impl BatchInFlight {
    /// Returns `true` if the batch is complete or has failed.
    pub fn is_ready(&mut self, gpu: &GpuDevice) -> bool {
        gpu.poll();
        self.is_mapped() || gpu.check().is_err()
    }

    fn is_mapped(&mut self) -> bool {
        self.n_mapped += self.mapped.try_iter().filter(Result::is_ok).count();
        self.n_mapped == 2
    }
}

/// Returns a callback that sends the outcome of a mapping.
fn report(
    sender: &Sender<Result<(), wgpu::BufferAsyncError>>,
) -> impl FnOnce(Result<(), wgpu::BufferAsyncError>) + Send + 'static {
    let sender = sender.clone();
    move |result| {
        // The receiver is gone if the batch has failed.
        let _ = sender.send(result);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::gpu::DeviceKind;

    /// Returns a queue whose network copies its inputs of three words to the result.
    fn queue(gpu: &GpuDevice) -> (BatchQueue, Vec<NetworkStep>) {
        let [target, result] = ["in", "out"].map(|label| DeviceBuffer::zeroed(gpu, label, 12));
        let copy = NetworkStep::Copy { from: (target.clone(), 3), to: (result.clone(), 3), n_words: 3 };
        let [input, result] = [target, result].map(|target| BatchInput { target, n_words: 3 });
        (BatchQueue::new(vec![input], DeviceBuffer::batch(gpu), result, 4), vec![copy])
    }

    #[expect(clippy::print_stderr, reason = "skipped tests print the reason")]
    fn device() -> Option<GpuDevice> {
        GpuDevice::open(DeviceKind::Software).map_err(|error| eprintln!("skipped: {error}")).ok()
    }

    #[test]
    fn memory_of_batches_is_reused() {
        let Some(gpu) = device() else { return };
        let (mut queue, steps) = queue(&gpu);
        let values: Vec<[f32; 3]> = (0_u8..8).map(|idx| [f32::from(idx), 0.5, -1.0]).collect();
        for n_samples in [1, 4, 3] {
            let first = queue.submit(&gpu, &steps, n_samples, &|_, idx| bytemuck::bytes_of(&values[idx]));
            let second =
                queue.submit(&gpu, &steps, n_samples, &|_, idx| bytemuck::bytes_of(&values[idx + 4]));
            for (batch, from) in [(first.unwrap(), 0), (second.unwrap(), 4)] {
                let expected = values[from..from + n_samples].as_flattened();
                queue.collect(&gpu, batch, |found| assert_eq!(found, expected)).unwrap();
            }
        }
        assert_eq!(queue.idle.len(), 2, "two batches were in flight at most");
    }

    #[test]
    fn lost_device_fails_its_batches() {
        let Some(gpu) = device() else { return };
        let (mut queue, steps) = queue(&gpu);
        let submit = |queue: &mut BatchQueue| queue.submit(&gpu, &steps, 4, &|_, _| &[1; 12]);
        let mut batch = submit(&mut queue).unwrap();
        gpu.device.destroy();
        assert!(submit(&mut queue).is_err(), "a lost device accepts nothing");
        assert!(batch.is_ready(&gpu), "nobody waits for a lost device");
        let error = queue.collect(&gpu, batch, |_| ()).unwrap_err().to_string();
        assert!(error.contains(gpu.name()), "{error}");
    }
}
