//! Construction of a network's steps: runs of steps that count the same unit, and weights by name.

use crate::formats::CheckpointError;
use crate::models::LoadGpuError;
use crate::models::pi05::layers::LayerSource;
use crate::nn::gpu::ops::{DeviceWeights, OpBuilder, ProductEpilogue, SampleRows};
use crate::nn::gpu::steps::{NetworkStep, StepRun};
use crate::nn::gpu::{DeviceBuffer, Dispatch, GpuDevice, KernelCache};
use crate::weights::WeightsError;

/// Number of kinds of [`BatchUnit`].
pub(crate) const N_UNITS: usize = BatchUnit::Sample as usize + 1;

/// Unit of a batch, of which the kernels of a run count one kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum BatchUnit {
    /// A distinct image.
    Image,
    /// A token of a prompt.
    Token,
    /// A row of a prefix.
    Row,
    /// A sample.
    Sample,
}

/// Number of units of a batch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct UnitCounts {
    pub(crate) images: usize,
    pub(crate) tokens: usize,
    pub(crate) rows: usize,
    pub(crate) samples: usize,
}

/// A network under construction.
pub(crate) struct RunBuilder<'a> {
    pub(crate) ops: OpBuilder<'a>,
    pub(crate) source: LayerSource<'a>,
    /// Uniform buffer of the number of each [`BatchUnit`].
    counts: &'a [DeviceBuffer; N_UNITS],
    /// Largest batch.
    pub(crate) capacity: UnitCounts,
    pub(crate) runs: Vec<StepRun>,
}

impl UnitCounts {
    /// Returns the numbers in the order of [`BatchUnit`].
    pub(crate) fn by_unit(self) -> [usize; N_UNITS] {
        [self.images, self.tokens, self.rows, self.samples]
    }

    /// Returns the numbers for `n` such batches together.
    pub(crate) fn times(self, n: usize) -> Self {
        let Self { images, tokens, rows, samples } = self;
        Self { images: n * images, tokens: n * tokens, rows: n * rows, samples: n * samples }
    }
}

impl<'a> RunBuilder<'a> {
    pub(crate) fn new(
        gpu: &'a GpuDevice,
        source: LayerSource<'a>,
        counts: &'a [DeviceBuffer; N_UNITS],
        capacity: UnitCounts,
    ) -> Self {
        let ops = OpBuilder { gpu, kernels: KernelCache::default(), batch: &counts[0] };
        Self { ops, source, counts, capacity, runs: Vec::new() }
    }

    /// Starts a run whose steps count this unit.
    pub(crate) fn count(&mut self, unit: BatchUnit) {
        self.ops.batch = &self.counts[unit as usize];
        self.runs.push(StepRun { unit: unit as usize, steps: Vec::new() });
    }

    pub(crate) fn push(&mut self, dispatch: Dispatch) {
        self.push_step(NetworkStep::Run(dispatch));
    }

    pub(crate) fn push_step(&mut self, step: NetworkStep) {
        self.runs.last_mut().expect("a run has been started").steps.push(step);
    }

    /// Allocates a buffer with this number of words per unit.
    pub(crate) fn buffer(&self, label: &str, unit: BatchUnit, words_per_unit: usize) -> DeviceBuffer {
        DeviceBuffer::zeroed(self.ops.gpu, label, words_per_unit * self.capacity.by_unit()[unit as usize])
    }

    /// Uploads values.
    pub(crate) fn constant(&self, label: &str, values: &[f32]) -> DeviceBuffer {
        DeviceBuffer::of(self.ops.gpu, label, values)
    }

    /// Uploads the matrices of these names, one after the other.
    pub(crate) fn matrix(&self, names: &[String]) -> Result<DeviceWeights, LoadGpuError> {
        self.stored(names, &[])
    }

    /// Uploads linear layers with the same input, one after the other, from the tensors that `name` returns
    /// for each layer, and `weight` or `bias`.
    pub(crate) fn linear(
        &self,
        layers: &[&str],
        name: impl Fn(&str, &str) -> String,
    ) -> Result<DeviceWeights, LoadGpuError> {
        let mut bias = Vec::new();
        for layer in layers {
            bias.extend(self.vector(&name(layer, "bias"))?);
        }
        let names: Vec<String> = layers.iter().map(|layer| name(layer, "weight")).collect();
        self.stored(&names, &bias)
    }

    /// Reads a vector.
    pub(crate) fn vector(&self, name: &str) -> Result<Vec<f32>, LoadGpuError> {
        self.source.vector(name).map_err(unreadable)
    }

    fn stored(&self, names: &[String], bias: &[f32]) -> Result<DeviceWeights, LoadGpuError> {
        let tensors = names.iter().map(|name| self.source.tensor(name)).collect::<Result<Vec<_>, _>>();
        Ok(DeviceWeights::stored(self.ops.gpu, &tensors.map_err(unreadable)?, bias)?)
    }

    /// Adds a linear layer for all `n_rows` rows of each unit.
    pub(crate) fn multiply(
        &mut self,
        layer: &DeviceWeights,
        n_rows: usize,
        (a, out): (&DeviceBuffer, &DeviceBuffer),
        epilogue: ProductEpilogue,
    ) {
        let rows = SampleRows::all(n_rows);
        let step = self.ops.linear(layer, n_rows, (a, rows, None), (out, rows), epilogue);
        self.push(step);
    }
}

/// Returns the error of a checkpoint whose tensors cannot be read.
pub(crate) fn unreadable(error: WeightsError) -> LoadGpuError {
    LoadGpuError::Folder(CheckpointError::from(error).into())
}
