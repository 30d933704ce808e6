//! Encoder and decoder layers.

use super::layers::{StepList, TokenRows};
use crate::nn::gpu::ops::{AttentionShape, DeviceWeights, ProductEpilogue};
use crate::nn::gpu::steps::{NetworkStep, run};
use crate::nn::gpu::{DeviceBuffer, GpuError};

/// Blocks of PyTorch's stacked input projection of an attention.
const QUERY: usize = 0;
const KEY: usize = 1;
const VALUE: usize = 2;

/// Working memory of the layers, for the larger of memory and target.
pub(crate) struct LayerMemory {
    queries: DeviceBuffer,
    keys: DeviceBuffer,
    values: DeviceBuffer,
    attended: DeviceBuffer,
    hidden: DeviceBuffer,
    /// By sample: 1 if it has the optional token.
    pub(crate) present: DeviceBuffer,
    optional_key: Option<usize>,
}

impl StepList<'_> {
    /// Allocates the working memory for up to `n_rows` rows per sample.
    pub(crate) fn layer_memory(&self, n_rows: usize, optional_key: Option<usize>) -> LayerMemory {
        let rows = |label: &str, width: usize| self.buffer(label, n_rows * width);
        let (width, inner) = (self.architecture.hidden_dim, self.architecture.dim_feedforward);
        LayerMemory {
            queries: rows("queries", width),
            keys: rows("keys", width),
            values: rows("values", width),
            attended: rows("attended", width),
            hidden: rows("hidden", inner),
            present: self.buffer("present", 1),
            optional_key,
        }
    }

    /// Adds the encoder layer `name`, in place.
    pub(crate) fn encoder_layer(
        &mut self,
        name: &str,
        x: &TokenRows,
        positions: &DeviceBuffer,
        memory: &LayerMemory,
    ) -> Result<(), GpuError> {
        let attention = format!("{name}.self_attn");
        self.project_queries(&attention, x, positions, memory);
        self.attend(&attention, x, (x, positions), memory.optional_key, memory)?;
        self.layer_norm(&format!("{name}.norm1"), x);
        self.feed_forward(name, x, memory);
        self.layer_norm(&format!("{name}.norm2"), x);
        Ok(())
    }

    /// Adds the self-attention of the decoder layer `name` to the target, in place, and the projection of
    /// the queries of its cross-attention.
    pub(crate) fn attend_to_target(
        &mut self,
        name: &str,
        x: &TokenRows,
        query_positions: &DeviceBuffer,
        memory: &LayerMemory,
    ) -> Result<(), GpuError> {
        let attention = format!("{name}.self_attn");
        self.project_queries(&attention, x, query_positions, memory);
        self.attend(&attention, x, (x, query_positions), None, memory)?;
        self.layer_norm(&format!("{name}.norm1"), x);
        self.project_queries(&format!("{name}.multihead_attn"), x, query_positions, memory);
        Ok(())
    }

    /// Adds the cross-attention of the decoder layer `name`, whose queries are projected, and its
    /// feed-forward network, in place.
    pub(crate) fn attend_to_memory(
        &mut self,
        name: &str,
        x: &TokenRows,
        (tokens, positions): (&TokenRows, &DeviceBuffer),
        memory: &LayerMemory,
    ) -> Result<(), GpuError> {
        let attention = format!("{name}.multihead_attn");
        self.attend(&attention, x, (tokens, positions), memory.optional_key, memory)?;
        self.layer_norm(&format!("{name}.norm2"), x);
        self.feed_forward(name, x, memory);
        self.layer_norm(&format!("{name}.norm3"), x);
        Ok(())
    }

    /// Computes the target after the first decoder layer's self-attention, and the queries of its
    /// cross-attention, which are the same for every input. Returns the steps that copy both to each sample.
    pub(crate) fn constant_target(
        &mut self,
        x: &TokenRows,
        query_positions: &DeviceBuffer,
        memory: &LayerMemory,
    ) -> Result<[NetworkStep; 2], GpuError> {
        let earlier = std::mem::take(&mut self.steps);
        self.attend_to_target("transformer.decoder.layers.0", x, query_positions, memory)?;
        let mut steps = std::mem::replace(&mut self.steps, earlier);
        let n_words = x.n_rows * self.architecture.hidden_dim;
        let constant = |label: &str| DeviceBuffer::zeroed(self.ops.gpu, label, n_words);
        let (target, queries) = (constant("target"), constant("first queries"));
        let copy = |from: &DeviceBuffer, to: &DeviceBuffer| NetworkStep::Copy {
            from: (from.clone(), 0),
            to: (to.clone(), n_words),
            n_words,
        };
        steps.extend([copy(&x.buffer, &target), copy(&memory.queries, &queries)]);
        self.ops.batch.write(self.ops.gpu, 0, &[1_u32]);
        run(self.ops.gpu, &steps, 1)?;
        Ok([copy(&target, &x.buffer), copy(&queries, &memory.queries)])
    }

    /// Uploads one block of the input projection of the attention `name`. That of the queries includes the
    /// scale `1 / √head_width`.
    fn projection(&self, name: &str, block: usize) -> DeviceWeights {
        let width = self.architecture.hidden_dim;
        let head_width = width / self.architecture.n_heads;
        let factor = if block == QUERY { 1.0 / (head_width as f32).sqrt() } else { 1.0 };
        let scaled = |tensor: &str, len: usize| -> Vec<f32> {
            let values = self.state_dict.get(&format!("{name}.in_proj_{tensor}"));
            values[block * len..(block + 1) * len].iter().map(|x| x * factor).collect()
        };
        DeviceWeights::transposed(self.ops.gpu, &scaled("weight", width * width), &scaled("bias", width))
    }

    fn project_queries(
        &mut self,
        attention: &str,
        x: &TokenRows,
        positions: &DeviceBuffer,
        memory: &LayerMemory,
    ) {
        let layer = self.projection(attention, QUERY);
        let queries = TokenRows { buffer: memory.queries.clone(), n_rows: x.n_rows };
        self.linear(&layer, (x, Some(positions)), &queries, ProductEpilogue::Store);
    }

    /// Adds `x += out(attention(queries, keys, values))` with keys and values from `source`.
    fn attend(
        &mut self,
        attention: &str,
        x: &TokenRows,
        (source, positions): (&TokenRows, &DeviceBuffer),
        optional_key: Option<usize>,
        memory: &LayerMemory,
    ) -> Result<(), GpuError> {
        let of = |buffer: &DeviceBuffer, n_rows: usize| TokenRows { buffer: buffer.clone(), n_rows };
        let (keys, values) = (of(&memory.keys, source.n_rows), of(&memory.values, source.n_rows));
        let (key, value) = (self.projection(attention, KEY), self.projection(attention, VALUE));
        self.linear(&key, (source, Some(positions)), &keys, ProductEpilogue::Store);
        self.linear(&value, (source, None), &values, ProductEpilogue::Store);
        let shape = AttentionShape {
            n_queries: x.n_rows,
            n_keys: source.n_rows,
            width: self.architecture.hidden_dim,
            n_heads: self.architecture.n_heads,
            optional_key,
        };
        let inputs = [&memory.queries, &keys.buffer, &values.buffer];
        let step = self.ops.attention(shape, inputs, &memory.present, &memory.attended);
        let too_many = || self.ops.gpu.error(&format!("{} tokens are too many for it", source.n_rows));
        let step = step.ok_or_else(too_many)?;
        self.push(step);
        let attended = of(&memory.attended, x.n_rows);
        let out = self.weights(&format!("{attention}.out_proj"));
        self.linear(&out, (&attended, None), x, ProductEpilogue::Add);
        Ok(())
    }

    fn feed_forward(&mut self, name: &str, x: &TokenRows, memory: &LayerMemory) {
        let hidden = TokenRows { buffer: memory.hidden.clone(), n_rows: x.n_rows };
        let [first, second] = [1, 2].map(|idx| self.weights(&format!("{name}.linear{idx}")));
        self.linear(&first, (x, None), &hidden, ProductEpilogue::Relu);
        self.linear(&second, (&hidden, None), x, ProductEpilogue::Add);
    }
}
