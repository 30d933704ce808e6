//! Batches in flight: inputs on their way to the device, results on their way back. Every network computes
//! through a [`BatchQueue`].
//!
//! Inputs are written once, into host-visible memory, from which the device copies them before the first step
//! of their batch. Each batch in flight has such memory of its own, which is reused after it.

use gpu::{DeviceBuffer, GpuDevice, GpuError, PendingSubmission, read_mapped};
use rayon::prelude::*;

use super::steps::{StepRun, encode};

/// Alignment of mapped ranges in bytes.
const ALIGNMENT: u64 = wgpu::MAP_ALIGNMENT;

/// Counter of one kind of unit in a batch: samples, for example, or rows of sequences.
#[derive(Clone, Debug)]
pub struct UnitCounter {
    /// Uniform buffer of the number of units in a batch.
    pub count: DeviceBuffer,
    /// Largest number of units in a batch.
    pub capacity: usize,
}

/// Input or result of a network: an array with the same number of words for each unit of one kind.
#[derive(Clone, Debug)]
pub struct BatchArray {
    /// Memory of all units, without gaps.
    pub buffer: DeviceBuffer,
    /// Index of the unit among the queue's counters.
    pub unit: usize,
    /// Words of a unit.
    pub n_words: usize,
}

/// The way of a network's batches to the device, through its steps, and back. A batch has a number of units
/// of each of `UNITS` kinds.
#[derive(Debug)]
pub struct BatchQueue<const UNITS: usize> {
    counters: [UnitCounter; UNITS],
    inputs: Vec<BatchArray>,
    runs: Vec<StepRun>,
    result: BatchArray,
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
    submission: PendingSubmission,
    buffers: TransferBuffers,
    /// Bytes of the result.
    n_bytes: u64,
}

impl<const UNITS: usize> BatchQueue<UNITS> {
    /// Prepares batches with these inputs, which pass through all `runs` in their order. `result` is what is
    /// read back.
    ///
    /// # Panics
    /// If a run cannot take all units of a batch.
    #[must_use]
    pub fn new(
        counters: [UnitCounter; UNITS],
        inputs: Vec<BatchArray>,
        runs: Vec<StepRun>,
        result: BatchArray,
    ) -> Self {
        for run in &runs {
            let (capacity, limit) = (counters[run.unit].capacity, run.max_units());
            assert!(capacity <= limit, "{capacity} of unit {}, but its steps take {limit}", run.unit);
        }
        Self { counters, inputs, runs, result, idle: Vec::new() }
    }

    /// Uploads a batch and submits its steps. `counts` are the numbers of its units, and `bytes(input, unit)`
    /// returns a unit's part of an input. The threads of the current rayon pool share the copying.
    ///
    /// # Errors
    /// If the device fails.
    ///
    /// # Panics
    /// If the batch has more units than the capacity or no result, or a unit's part of an input does not have
    /// the size of its memory, rounded up to whole words.
    pub fn submit<'b>(
        &mut self,
        gpu: &GpuDevice,
        counts: [usize; UNITS],
        bytes: &(dyn Fn(usize, usize) -> &'b [u8] + Sync),
    ) -> Result<BatchInFlight, GpuError> {
        for (counter, count) in self.counters.iter().zip(counts) {
            assert!(
                count <= counter.capacity,
                "a batch of {counts:?} units, at most {:?}",
                self.capacities()
            );
        }
        assert!(counts[self.result.unit] > 0, "a batch of {counts:?} units has no result");
        let buffers = self.idle.pop().unwrap_or_else(|| self.allocate(gpu));
        self.write(gpu, &buffers.upload, counts, bytes)?;
        let mut encoder = gpu.encoder();
        let (upload, download) = (&buffers.upload, &buffers.download);
        for (counter, offset) in self.counters.iter().zip((0..).step_by(4)) {
            encoder.copy_buffer_to_buffer(upload, offset, &counter.count.0, 0, Some(4));
        }
        for (input, offset) in self.inputs.iter().zip(self.offsets()) {
            let n_bytes = input.n_bytes(counts);
            encoder.copy_buffer_to_buffer(upload, offset, &input.buffer.0, 0, Some(n_bytes));
        }
        for run in self.runs.iter().filter(|run| counts[run.unit] > 0) {
            encode(&mut encoder, &run.steps, counts[run.unit]);
        }
        let n_bytes = self.result.n_bytes(counts);
        encoder.copy_buffer_to_buffer(&self.result.buffer.0, 0, download, 0, Some(n_bytes));
        let maps = [(upload, wgpu::MapMode::Write, upload.size()), (download, wgpu::MapMode::Read, n_bytes)];
        let submission = PendingSubmission::new(gpu, encoder, &maps);
        gpu.check()?;
        Ok(BatchInFlight { submission, buffers, n_bytes })
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
        batch.submission.wait(gpu)?;
        let read = |bytes: &[u8]| read(bytemuck::cast_slice(bytes));
        read_mapped(gpu, &batch.buffers.download, batch.n_bytes, read)?;
        self.idle.push(batch.buffers);
        Ok(())
    }

    /// Writes the counts and inputs of a batch into mapped memory.
    fn write<'b>(
        &self,
        gpu: &GpuDevice,
        upload: &wgpu::Buffer,
        counts: [usize; UNITS],
        bytes: &(dyn Fn(usize, usize) -> &'b [u8] + Sync),
    ) -> Result<(), GpuError> {
        let header = counts.map(|count| (count as u32).to_le_bytes());
        write_parts(gpu, upload, (0, 4), UNITS, &|unit| &header[unit]);
        for ((index, input), offset) in self.inputs.iter().enumerate().zip(self.offsets()) {
            let (stride, count) = (input.n_words as u64 * 4, counts[input.unit]);
            let part = |unit: usize| {
                let (bytes, n_words) = (bytes(index, unit), input.n_words);
                assert_eq!(bytes.len().div_ceil(4), n_words, "words of a unit of input {index}");
                bytes
            };
            if stride.is_multiple_of(ALIGNMENT) {
                (0..count).into_par_iter().for_each(|unit| {
                    let offset = offset + unit as u64 * stride;
                    write_parts(gpu, upload, (offset, stride), 1, &|_| part(unit));
                });
            } else if count > 0 {
                write_parts(gpu, upload, (offset, stride), count, &part);
            }
        }
        upload.unmap();
        gpu.check()
    }

    /// Returns the offset of each input in the upload memory, whose size follows. The counts come first.
    fn offsets(&self) -> impl Iterator<Item = u64> {
        let inputs = self.inputs.iter().map(|input| input.n_bytes(self.capacities()));
        std::iter::once(UNITS as u64 * 4).chain(inputs).scan(0, |end, n_bytes| {
            *end += n_bytes.next_multiple_of(ALIGNMENT);
            Some(*end)
        })
    }

    fn capacities(&self) -> [usize; UNITS] {
        self.counters.each_ref().map(|counter| counter.capacity)
    }

    fn allocate(&self, gpu: &GpuDevice) -> TransferBuffers {
        let create = |label, size, usage, mapped_at_creation| {
            let descriptor = wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation };
            gpu.device.create_buffer(&descriptor)
        };
        let [from, to] = [wgpu::BufferUsages::COPY_SRC, wgpu::BufferUsages::COPY_DST];
        let upload_bytes = self.offsets().fold(0, u64::max);
        let download_bytes = self.result.n_bytes(self.capacities());
        TransferBuffers {
            upload: create("upload", upload_bytes, from | wgpu::BufferUsages::MAP_WRITE, true),
            download: create("download", download_bytes, to | wgpu::BufferUsages::MAP_READ, false),
        }
    }
}

impl BatchArray {
    /// Returns the size of the array in a batch with these numbers of units.
    fn n_bytes<const UNITS: usize>(&self, counts: [usize; UNITS]) -> u64 {
        (counts[self.unit] * self.n_words * 4) as u64
    }
}

impl BatchInFlight {
    /// Returns `true` if the batch is complete or has failed.
    pub fn is_ready(&mut self, gpu: &GpuDevice) -> bool {
        self.submission.is_ready(gpu)
    }
}

/// Writes successive parts of `stride` bytes, from `offset` on, into mapped memory.
fn write_parts<'b>(
    gpu: &GpuDevice,
    upload: &wgpu::Buffer,
    (offset, stride): (u64, u64),
    count: usize,
    part: &dyn Fn(usize) -> &'b [u8],
) {
    match upload.get_mapped_range_mut(offset..offset + stride * count as u64) {
        Ok(mut mapped) => {
            for unit in 0..count {
                let (bytes, first) = (part(unit), unit * stride as usize);
                mapped.slice(first..first + bytes.len()).copy_from_slice(bytes);
            }
        }
        Err(error) => gpu.fail(&error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::gpu::ops::OpBuilder;
    use crate::nn::gpu::steps::NetworkStep;
    use crate::nn::gpu::{AdapterKind, KernelCache};

    /// Largest numbers of units. A batch has the last one once.
    const UNIT_CAPACITIES: [usize; 3] = [3, 5, 1];
    const WHOLE: usize = 2;
    /// Words of the other two: one keeps the alignment of mapped ranges, the other does not.
    const UNIT_WORDS: [usize; 2] = [4, 3];

    /// Returns a queue whose network copies its inputs of three words to the result.
    fn queue(gpu: &GpuDevice) -> BatchQueue<1> {
        let [input, result] = ["in", "out"].map(|label| {
            let buffer = DeviceBuffer::zeroed(gpu, label, 12);
            BatchArray { buffer, unit: 0, n_words: 3 }
        });
        let [from, to] = [&input, &result].map(|array| (array.buffer.clone(), array.n_words));
        let copy = NetworkStep::Copy { from, to, n_words: 3 };
        let samples = UnitCounter { count: DeviceBuffer::uniform(gpu, "batch"), capacity: 4 };
        BatchQueue::new([samples], vec![input], vec![StepRun { unit: 0, steps: vec![copy] }], result)
    }

    /// Returns a queue with an input for each of two kinds of units. Its network adds each input to an array
    /// of ones, of which that of `unit` is the result, whole.
    fn queue_of_two_units(gpu: &GpuDevice, unit: usize) -> BatchQueue<3> {
        let counters = UNIT_CAPACITIES
            .map(|capacity| UnitCounter { count: DeviceBuffer::uniform(gpu, "batch"), capacity });
        let (mut inputs, mut runs, mut sums) = (Vec::new(), Vec::new(), Vec::new());
        for (unit, n_words) in UNIT_WORDS.into_iter().enumerate() {
            let len = UNIT_CAPACITIES[unit] * n_words;
            let ones = DeviceBuffer::of(gpu, "ones", &vec![1.0_f32; len]);
            let [input, sum] = ["input", "sum"].map(|label| DeviceBuffer::zeroed(gpu, label, len));
            let reset = NetworkStep::Copy { from: (ones, 0), to: (sum.clone(), 0), n_words: len };
            runs.push(StepRun { unit: WHOLE, steps: vec![reset] });
            let batch = &counters[unit].count;
            let mut ops = OpBuilder { gpu, kernels: KernelCache::default(), batch };
            let add = NetworkStep::Run(ops.add_scaled(1.0, n_words, &input, &sum));
            runs.push(StepRun { unit, steps: vec![add] });
            inputs.push(BatchArray { buffer: input, unit, n_words });
            sums.push(BatchArray { buffer: sum, unit: WHOLE, n_words: len });
        }
        BatchQueue::new(counters, inputs, runs, sums.swap_remove(unit))
    }

    fn device() -> GpuDevice {
        crate::nn::gpu::open(AdapterKind::Software, None).unwrap()
    }

    #[test]
    #[ignore = "needs a Vulkan driver"]
    fn memory_of_batches_is_reused() {
        let gpu = device();
        let mut queue = queue(&gpu);
        let values: Vec<[f32; 3]> = (0_u8..8).map(|idx| [f32::from(idx), 0.5, -1.0]).collect();
        for n_samples in [1, 4, 3] {
            let first = queue.submit(&gpu, [n_samples], &|_, idx| bytemuck::bytes_of(&values[idx]));
            let second = queue.submit(&gpu, [n_samples], &|_, idx| bytemuck::bytes_of(&values[idx + 4]));
            for (batch, from) in [(first.unwrap(), 0), (second.unwrap(), 4)] {
                let expected = values[from..from + n_samples].as_flattened();
                queue.collect(&gpu, batch, |found| assert_eq!(found, expected)).unwrap();
            }
        }
        assert_eq!(queue.idle.len(), 2, "two batches were in flight at most");
    }

    #[test]
    #[ignore = "needs a Vulkan driver"]
    fn every_unit_has_its_own_count() {
        let gpu = device();
        let values: Vec<f32> = (0_u8..64).map(f32::from).collect();
        for unit in [0, 1] {
            let mut queue = queue_of_two_units(&gpu, unit);
            let first = |batch: usize, input: usize| 20 * batch + 10 * input;
            for pair in [[[1, 2, 1], [3, 5, 1]], [[2, 0, 1], [0, 4, 1]], [[3, 1, 1], [0, 0, 1]]] {
                let mut submit = |batch: usize| {
                    let bytes = |input: usize, unit: usize| {
                        let start = first(batch, input) + unit * UNIT_WORDS[input];
                        bytemuck::cast_slice(&values[start..start + UNIT_WORDS[input]])
                    };
                    queue.submit(&gpu, pair[batch], &bytes).unwrap()
                };
                let batches = [submit(0), submit(1)];
                for (index, (batch, counts)) in batches.into_iter().zip(pair).enumerate() {
                    let mut expected = vec![1.0; UNIT_CAPACITIES[unit] * UNIT_WORDS[unit]];
                    let counted = expected.iter_mut().take(counts[unit] * UNIT_WORDS[unit]);
                    counted.zip(&values[first(index, unit)..]).for_each(|(sum, x)| *sum += x);
                    queue.collect(&gpu, batch, |found| assert_eq!(found, expected, "{counts:?}")).unwrap();
                }
            }
            assert_eq!(queue.idle.len(), 2, "two batches were in flight at most");
        }
    }

    #[test]
    #[ignore = "needs a Vulkan driver"]
    fn queue_refuses_what_does_not_fit() {
        let gpu = device();
        let mut queue = queue(&gpu);
        let cases = [
            (5, &[1; 12][..], "a batch of [5] units, at most [4]"),
            (0, &[1; 12], "a batch of [0] units has no result"),
            (1, &[1; 8], "words of a unit of input 0"),
            (1, &[1; 13], "words of a unit of input 0"),
        ];
        for (n_samples, bytes, expected) in cases {
            let submit = || queue.submit(&gpu, [n_samples], &|_, _| bytes).is_ok();
            let panic = std::panic::catch_unwind(std::panic::AssertUnwindSafe(submit)).unwrap_err();
            let message = panic.downcast_ref::<String>().unwrap();
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    #[ignore = "needs a Vulkan driver"]
    fn lost_device_fails_its_batches() {
        let gpu = device();
        let mut queue = queue(&gpu);
        let submit = |queue: &mut BatchQueue<1>| queue.submit(&gpu, [4], &|_, _| &[1; 12]);
        let mut batch = submit(&mut queue).unwrap();
        gpu.device.destroy();
        assert!(submit(&mut queue).is_err(), "a lost device accepts nothing");
        assert!(batch.is_ready(&gpu), "nobody waits for a lost device");
        let error = queue.collect(&gpu, batch, |_| ()).unwrap_err().to_string();
        assert!(error.contains(gpu.name()), "{error}");
    }
}
