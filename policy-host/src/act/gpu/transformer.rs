//! Encoder and decoder layers.

use super::layers::{StepList, TokenRows};
use crate::nn::gpu::ops::{AttentionShape, DeviceWeights, ProductEpilogue};
use crate::nn::gpu::readback::{NetworkStep, run};
use crate::nn::gpu::{DeviceBuffer, GpuError};

/// The projections of an attention. The query projection includes the scale `1 / √head_width`.
struct AttentionWeights {
    query: DeviceWeights,
    key: DeviceWeights,
    value: DeviceWeights,
    out: DeviceWeights,
}

/// Working memory of the layers, for the larger of memory and target.
pub(super) struct LayerMemory {
    queries: DeviceBuffer,
    keys: DeviceBuffer,
    values: DeviceBuffer,
    attended: DeviceBuffer,
    hidden: DeviceBuffer,
    /// By sample: 1 if it has the optional token.
    pub(super) present: DeviceBuffer,
    optional_key: Option<usize>,
}

/// Error: the scores of a query exceed the memory of a workgroup.
#[derive(Clone, Copy, Debug)]
pub(super) struct TooManyTokens(pub(super) usize);

impl StepList<'_> {
    /// Allocates the working memory for up to `n_rows` rows per sample.
    pub(super) fn layer_memory(&self, n_rows: usize, optional_key: Option<usize>) -> LayerMemory {
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
    pub(super) fn encoder_layer(
        &mut self,
        name: &str,
        x: &TokenRows,
        positions: &DeviceBuffer,
        memory: &LayerMemory,
    ) -> Result<(), TooManyTokens> {
        let attention = self.attention_weights(&format!("{name}.self_attn"));
        self.project_queries(&attention, x, positions, memory);
        self.attend(&attention, x, (x, Some(positions)), memory.optional_key, memory)?;
        self.layer_norm(&format!("{name}.norm1"), x);
        self.feed_forward(name, x, memory);
        self.layer_norm(&format!("{name}.norm2"), x);
        Ok(())
    }

    /// Adds the self-attention of the decoder layer `name` to the target, in place, and the projection of
    /// the queries of its cross-attention.
    pub(super) fn attend_to_target(
        &mut self,
        name: &str,
        x: &TokenRows,
        query_positions: &DeviceBuffer,
        memory: &LayerMemory,
    ) -> Result<(), TooManyTokens> {
        let attention = self.attention_weights(&format!("{name}.self_attn"));
        self.project_queries(&attention, x, query_positions, memory);
        self.attend(&attention, x, (x, Some(query_positions)), None, memory)?;
        self.layer_norm(&format!("{name}.norm1"), x);
        let cross = self.attention_weights(&format!("{name}.multihead_attn"));
        self.project_queries(&cross, x, query_positions, memory);
        Ok(())
    }

    /// Adds the cross-attention of the decoder layer `name`, whose queries are projected, and its
    /// feed-forward network, in place.
    pub(super) fn attend_to_memory(
        &mut self,
        name: &str,
        x: &TokenRows,
        (tokens, positions): (&TokenRows, &DeviceBuffer),
        memory: &LayerMemory,
    ) -> Result<(), TooManyTokens> {
        let cross = self.attention_weights(&format!("{name}.multihead_attn"));
        self.attend(&cross, x, (tokens, Some(positions)), memory.optional_key, memory)?;
        self.layer_norm(&format!("{name}.norm2"), x);
        self.feed_forward(name, x, memory);
        self.layer_norm(&format!("{name}.norm3"), x);
        Ok(())
    }

    /// Computes the target after the first decoder layer's self-attention, and the queries of its
    /// cross-attention, which are the same for every input. Replaces the steps so far, which must be none,
    /// by copies of both to each sample.
    pub(super) fn constant_target(
        &mut self,
        x: &TokenRows,
        query_positions: &DeviceBuffer,
        memory: &LayerMemory,
    ) -> Result<Result<Vec<NetworkStep>, GpuError>, TooManyTokens> {
        let earlier = std::mem::take(&mut self.steps);
        self.attend_to_target("transformer.decoder.layers.0", x, query_positions, memory)?;
        let n_words = x.n_rows * self.architecture.hidden_dim;
        let constant = |label: &str| DeviceBuffer::zeroed(self.ops.gpu, label, n_words);
        let (target, queries) = (constant("target"), constant("first queries"));
        let copy = |from: &DeviceBuffer, to: &DeviceBuffer, stride: usize| NetworkStep::Copy {
            from: (from.clone(), 0),
            to: (to.clone(), stride),
            n_words,
        };
        self.steps.push(copy(&x.buffer, &target, 0));
        self.steps.push(copy(&memory.queries, &queries, 0));
        self.ops.batch.write(self.ops.gpu, 0, &[1_u32]);
        let computed = run(self.ops.gpu, &self.steps, 1);
        self.steps = earlier;
        let copies = vec![copy(&target, &x.buffer, n_words), copy(&queries, &memory.queries, n_words)];
        Ok(computed.map(|()| copies))
    }

    fn attention_weights(&self, name: &str) -> AttentionWeights {
        let width = self.architecture.hidden_dim;
        let projection = |block: usize, factor: f32| {
            let scaled = |tensor: &str, len: usize| -> Vec<f32> {
                let values = self.state_dict.get(&format!("{name}.in_proj_{tensor}"));
                values[block * len..(block + 1) * len].iter().map(|x| x * factor).collect()
            };
            DeviceWeights::transposed(self.ops.gpu, &scaled("weight", width * width), &scaled("bias", width))
        };
        let scale = 1.0 / ((width / self.architecture.n_heads) as f32).sqrt();
        AttentionWeights {
            query: projection(0, scale),
            key: projection(1, 1.0),
            value: projection(2, 1.0),
            out: self.weights(&format!("{name}.out_proj")),
        }
    }

    fn project_queries(
        &mut self,
        attention: &AttentionWeights,
        x: &TokenRows,
        positions: &DeviceBuffer,
        memory: &LayerMemory,
    ) {
        let queries = TokenRows { buffer: memory.queries.clone(), n_rows: x.n_rows };
        self.linear(&attention.query, (x, Some(positions)), &queries, ProductEpilogue::Store);
    }

    /// Adds `x += out(attention(queries, keys, values))` with keys and values from `source`.
    fn attend(
        &mut self,
        attention: &AttentionWeights,
        x: &TokenRows,
        (source, positions): (&TokenRows, Option<&DeviceBuffer>),
        optional_key: Option<usize>,
        memory: &LayerMemory,
    ) -> Result<(), TooManyTokens> {
        let of = |buffer: &DeviceBuffer, n_rows: usize| TokenRows { buffer: buffer.clone(), n_rows };
        let (keys, values) = (of(&memory.keys, source.n_rows), of(&memory.values, source.n_rows));
        self.linear(&attention.key, (source, positions), &keys, ProductEpilogue::Store);
        self.linear(&attention.value, (source, None), &values, ProductEpilogue::Store);
        let shape = AttentionShape {
            n_queries: x.n_rows,
            n_keys: source.n_rows,
            width: self.architecture.hidden_dim,
            n_heads: self.architecture.n_heads,
            optional_key,
        };
        let inputs = [&memory.queries, &keys.buffer, &values.buffer];
        let step = self.ops.attention(shape, inputs, &memory.present, &memory.attended);
        self.push(step.ok_or(TooManyTokens(source.n_rows))?);
        let attended = of(&memory.attended, x.n_rows);
        self.linear(&attention.out, (&attended, None), x, ProductEpilogue::Add);
        Ok(())
    }

    fn feed_forward(&mut self, name: &str, x: &TokenRows, memory: &LayerMemory) {
        let hidden = TokenRows { buffer: memory.hidden.clone(), n_rows: x.n_rows };
        let [first, second] = [1, 2].map(|idx| self.weights(&format!("{name}.linear{idx}")));
        self.linear(&first, (x, None), &hidden, ProductEpilogue::Relu);
        self.linear(&second, (&hidden, None), x, ProductEpilogue::Add);
    }
}
