//! Construction of a network's steps: buffers for the largest batch, weights by name, and the list of steps.

use crate::models::act::architecture::Architecture;
use crate::nn::gpu::ops::{DeviceWeights, OpBuilder, ProductEpilogue, SampleRows};
use crate::nn::gpu::steps::NetworkStep;
use crate::nn::gpu::{DeviceBuffer, Dispatch};
use crate::weights::StateDict;

/// A network under construction.
pub(crate) struct StepList<'a> {
    pub(crate) ops: OpBuilder<'a>,
    pub(crate) architecture: &'a Architecture,
    pub(crate) state_dict: &'a StateDict,
    /// Largest number of samples in a batch.
    pub(crate) capacity: usize,
    pub(crate) steps: Vec<NetworkStep>,
}

/// Rows of width `d`, `n_rows` of them per sample.
#[derive(Clone, Debug)]
pub(crate) struct TokenRows {
    pub(crate) buffer: DeviceBuffer,
    pub(crate) n_rows: usize,
}

impl StepList<'_> {
    /// Allocates a buffer with this number of words per sample.
    pub(crate) fn buffer(&self, label: &str, words_per_sample: usize) -> DeviceBuffer {
        DeviceBuffer::zeroed(self.ops.gpu, label, words_per_sample * self.capacity)
    }

    /// Allocates rows of this width.
    pub(crate) fn rows(&self, label: &str, n_rows: usize, width: usize) -> TokenRows {
        TokenRows { buffer: self.buffer(label, n_rows * width), n_rows }
    }

    /// Uploads a tensor.
    pub(crate) fn tensor(&self, name: &str) -> DeviceBuffer {
        DeviceBuffer::of(self.ops.gpu, name, self.state_dict.get(name))
    }

    /// Uploads the weights of the linear layer `name`.
    pub(crate) fn weights(&self, name: &str) -> DeviceWeights {
        let [weight, bias] = ["weight", "bias"].map(|part| self.state_dict.get(&format!("{name}.{part}")));
        DeviceWeights::transposed(self.ops.gpu, weight, bias)
    }

    pub(crate) fn push(&mut self, dispatch: Dispatch) {
        self.steps.push(NetworkStep::Run(dispatch));
    }

    /// Adds a linear layer from all rows of `a`, plus position embeddings if given, to all rows of `out`.
    pub(crate) fn linear(
        &mut self,
        layer: &DeviceWeights,
        (a, positions): (&TokenRows, Option<&DeviceBuffer>),
        out: &TokenRows,
        epilogue: ProductEpilogue,
    ) {
        let rows = SampleRows::all(a.n_rows);
        let step =
            self.ops.linear(layer, a.n_rows, (&a.buffer, rows, positions), (&out.buffer, rows), epilogue);
        self.push(step);
    }

    /// Adds the layer normalisation `name` of all rows of `x`, in place.
    pub(crate) fn layer_norm(&mut self, name: &str, x: &TokenRows) {
        let [weight, bias] = ["weight", "bias"].map(|part| self.tensor(&format!("{name}.{part}")));
        let width = self.architecture.hidden_dim;
        let step = self.ops.layer_norm((&weight, &bias), (x.n_rows, width), &x.buffer);
        self.push(step);
    }
}
