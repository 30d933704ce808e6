//! Gemma: the parts of a layer that the language model and the action expert share, and the language model.

use super::runs::{BatchUnit, RunBuilder};
use crate::models::LoadGpuError;
use crate::models::pi05::architecture::GemmaConfig;
use crate::models::pi05::checkpoint::names::LayerStack;
use crate::models::pi05::layers::EPSILON;
use crate::nn::gpu::DeviceBuffer;
use crate::nn::gpu::ops::{DeviceWeights, ProductEpilogue};
use crate::nn::gpu::sequences::{RotaryRows, RowNorm, SequenceInput, SequenceShape};

/// The matrices of a layer, but for those of keys and values.
pub(crate) struct LayerWeights {
    pub(crate) q_proj: DeviceWeights,
    pub(crate) o_proj: DeviceWeights,
    pub(crate) gate_proj: DeviceWeights,
    pub(crate) up_proj: DeviceWeights,
    pub(crate) down_proj: DeviceWeights,
}

/// Working memory of a stack of layers, and its rows: `n_rows` per unit.
#[derive(Debug)]
pub(crate) struct StackBuffers {
    pub(crate) config: GemmaConfig,
    pub(crate) n_rows: usize,
    pub(crate) x: DeviceBuffer,
    pub(crate) normed: DeviceBuffer,
    pub(crate) queries: DeviceBuffer,
    pub(crate) heads: DeviceBuffer,
    pub(crate) hidden: DeviceBuffer,
    /// Position of every row.
    pub(crate) positions: DeviceBuffer,
    /// Rows of every sample, for attention.
    pub(crate) spans: DeviceBuffer,
}

/// Returns the largest number of words of a row in a buffer of a stack.
pub(crate) fn max_words(config: GemmaConfig) -> usize {
    let GemmaConfig { hidden_size, intermediate_size, head_dim, .. } = config;
    let heads = config.num_attention_heads * head_dim;
    [hidden_size, intermediate_size, heads, 2 * head_dim].into_iter().fold(0, usize::max)
}

impl RunBuilder<'_> {
    pub(crate) fn stack_buffers(&self, config: GemmaConfig, unit: BatchUnit, n_rows: usize) -> StackBuffers {
        let heads = config.num_attention_heads * config.head_dim;
        let rows = |label: &str, width: usize| self.buffer(label, unit, n_rows * width);
        StackBuffers {
            config,
            n_rows,
            x: rows("x", config.hidden_size),
            normed: rows("normed", config.hidden_size),
            queries: rows("queries", heads),
            heads: rows("heads", heads),
            hidden: rows("hidden", config.intermediate_size),
            positions: rows("positions", 1),
            spans: self.buffer("spans", BatchUnit::Sample, 4),
        }
    }

    /// Uploads the matrices of a layer's keys and values, one after the other.
    pub(crate) fn key_weights(&self, part: LayerStack, layer: usize) -> Result<DeviceWeights, LoadGpuError> {
        let name = |module: &str| self.source.names.layer(part, layer, &format!("self_attn.{module}.weight"));
        self.matrix(&[name("k_proj"), name("v_proj")])
    }

    /// Uploads the other matrices of a layer.
    pub(crate) fn layer_weights(&self, part: LayerStack, layer: usize) -> Result<LayerWeights, LoadGpuError> {
        let matrix =
            |module: &str| self.matrix(&[self.source.names.layer(part, layer, &format!("{module}.weight"))]);
        Ok(LayerWeights {
            q_proj: matrix("self_attn.q_proj")?,
            o_proj: matrix("self_attn.o_proj")?,
            gate_proj: matrix("mlp.gate_proj")?,
            up_proj: matrix("mlp.up_proj")?,
            down_proj: matrix("mlp.down_proj")?,
        })
    }

    /// Adds an RMS normalisation from `x` to `normed`.
    pub(crate) fn rms_norm(&mut self, stack: &StackBuffers, affine: (&DeviceBuffer, &DeviceBuffer)) {
        let shape = (stack.n_rows, stack.config.hidden_size);
        let step = self.ops.normalise(RowNorm::Rms(EPSILON), shape, &stack.x, affine, &stack.normed);
        self.push(step);
    }

    /// Adds the keys and values of the normalised rows, `[rows, 2 · head_width]`.
    pub(crate) fn store_keys(
        &mut self,
        weights: &DeviceWeights,
        stack: &StackBuffers,
        angles: &DeviceBuffer,
        keys: &DeviceBuffer,
    ) {
        let head_width = stack.config.head_dim;
        self.multiply(weights, stack.n_rows, (&stack.normed, keys), ProductEpilogue::Store);
        self.apply_rotary(stack, (2 * head_width, 1), angles, keys);
    }

    /// Adds the queries of the normalised rows.
    pub(crate) fn store_queries(
        &mut self,
        weights: &LayerWeights,
        stack: &StackBuffers,
        angles: &DeviceBuffer,
    ) {
        let GemmaConfig { num_attention_heads: n_heads, head_dim: head_width, .. } = stack.config;
        let rows = (&stack.normed, &stack.queries);
        self.multiply(&weights.q_proj, stack.n_rows, rows, ProductEpilogue::Store);
        self.apply_rotary(stack, (n_heads * head_width, n_heads), angles, &stack.queries);
    }

    fn apply_rotary(
        &mut self,
        stack: &StackBuffers,
        (stride, n_heads): (usize, usize),
        angles: &DeviceBuffer,
        x: &DeviceBuffer,
    ) {
        let head_width = stack.config.head_dim;
        let rows = RotaryRows { n_rows: stack.n_rows, stride, n_heads, head_width };
        let step = self.ops.rotate(rows, (angles, &stack.positions), x);
        self.push(step);
    }

    /// Adds the hidden layer of an MLP of the normalised rows, `gelu(gate) · up`.
    pub(crate) fn hidden(&mut self, weights: &LayerWeights, stack: &StackBuffers) {
        let rows = (&stack.normed, &stack.hidden);
        self.multiply(&weights.gate_proj, stack.n_rows, rows, ProductEpilogue::Gelu);
        self.multiply(&weights.up_proj, stack.n_rows, rows, ProductEpilogue::Multiply);
    }

    /// Adds the language model, whose rows are in `stack.x`, in place. Returns the keys and values
    /// `[rows, 2 · head_width]` of every layer.
    pub(crate) fn prefill(
        &mut self,
        stack: &StackBuffers,
        max_length: usize,
        angles: &DeviceBuffer,
    ) -> Result<Vec<DeviceBuffer>, LoadGpuError> {
        let GemmaConfig { hidden_size, num_hidden_layers, head_dim, .. } = stack.config;
        let n_heads = stack.config.num_attention_heads;
        let names = self.source.names;
        let zero = self.constant("shift", &vec![0.0; hidden_size]);
        let shape = SequenceShape {
            n_heads,
            head_width: head_dim,
            shares_keys: true,
            max_queries: max_length,
            suffix: 0,
        };
        let mut cache = Vec::with_capacity(num_hidden_layers);
        for layer in 0..num_hidden_layers {
            let scale = |name: &str| -> Result<DeviceBuffer, LoadGpuError> {
                let stored = self.vector(&names.layer(LayerStack::Prefix, layer, name))?;
                let scale: Vec<f32> = stored.into_iter().map(|weight| 1.0 + weight).collect();
                Ok(self.constant("scale", &scale))
            };
            let (input_layernorm, post_attention_layernorm) =
                (scale("input_layernorm.weight")?, scale("post_attention_layernorm.weight")?);
            let keys = self.buffer("keys", BatchUnit::Row, 2 * head_dim);
            let key_weights = self.key_weights(LayerStack::Prefix, layer)?;
            self.rms_norm(stack, (&input_layernorm, &zero));
            self.store_keys(&key_weights, stack, angles, &keys);
            cache.push(keys);
            // Nothing reads what the last layer would add to the tokens.
            if layer + 1 == num_hidden_layers {
                break;
            }
            let (keys, weights) = (&cache[layer], self.layer_weights(LayerStack::Prefix, layer)?);
            self.store_queries(&weights, stack, angles);
            self.count(BatchUnit::Sample);
            let (queries, spans) = (&stack.queries, &stack.spans);
            self.attend(shape, SequenceInput { queries, prefix: keys, suffix: keys, spans }, &stack.heads)?;
            self.count(BatchUnit::Row);
            self.multiply(&weights.o_proj, 1, (&stack.heads, &stack.x), ProductEpilogue::Add);
            self.rms_norm(stack, (&post_attention_layernorm, &zero));
            self.hidden(&weights, stack);
            self.multiply(&weights.down_proj, 1, (&stack.hidden, &stack.x), ProductEpilogue::Add);
        }
        Ok(cache)
    }
}
