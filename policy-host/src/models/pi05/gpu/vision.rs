//! The vision tower: from the patches of distinct images to tokens of the language model.

use super::runs::{BatchUnit, RunBuilder};
use crate::models::LoadGpuError;
use crate::models::pi05::architecture::SiglipConfig;
use crate::models::pi05::checkpoint::names::LayerStack;
use crate::models::pi05::layers::EPSILON;
use crate::models::pi05::siglip::PATCH_VALUES;
use crate::nn::gpu::DeviceBuffer;
use crate::nn::gpu::ops::ProductEpilogue;
use crate::nn::gpu::sequences::{MAX_HEAD_WIDTH, RowNorm, SequenceInput, SequenceShape, SequenceSpan};
use crate::nn::gpu::steps::NetworkStep;

/// Input and output of the vision tower.
pub(crate) struct VisionBuffers {
    /// Patches `[images, patches, PATCH_VALUES]`.
    pub(crate) patches: DeviceBuffer,
    /// Tokens `[images, patches, prefix width]`.
    pub(crate) tokens: DeviceBuffer,
}

/// Working memory of the layers.
struct LayerBuffers {
    x: DeviceBuffer,
    normed: DeviceBuffer,
    queries: DeviceBuffer,
    /// Keys and values of all heads.
    keys: DeviceBuffer,
    heads: DeviceBuffer,
    hidden: DeviceBuffer,
    spans: DeviceBuffer,
}

/// Returns the largest number of words of an image in a buffer of the vision tower.
pub(crate) fn max_words(config: SiglipConfig, prefix_width: usize) -> usize {
    let SiglipConfig { hidden_size: width, intermediate_size: hidden, n_patches, .. } = config;
    n_patches * [PATCH_VALUES, 2 * width, hidden, prefix_width].into_iter().fold(0, usize::max)
}

impl RunBuilder<'_> {
    /// Adds the vision tower and the projector to the language model.
    pub(crate) fn vision(
        &mut self,
        config: SiglipConfig,
        prefix_width: usize,
    ) -> Result<VisionBuffers, LoadGpuError> {
        let SiglipConfig { hidden_size: width, num_hidden_layers: depth, n_patches, .. } = config;
        let names = self.source.names;
        let buffers = VisionBuffers {
            patches: self.buffer("patches", BatchUnit::Image, n_patches * PATCH_VALUES),
            tokens: self.buffer("image tokens", BatchUnit::Image, n_patches * prefix_width),
        };
        let memory = self.layer_buffers(config);
        let position_embedding = self.constant("positions", &self.vector(&names.position_embedding())?);
        let patch_embedding = self.linear(&[""], |_, tensor| names.patch_embedding(tensor))?;
        self.count(BatchUnit::Image);
        self.push_step(NetworkStep::Copy {
            from: (position_embedding, 0),
            to: (memory.x.clone(), n_patches * width),
            n_words: n_patches * width,
        });
        self.multiply(&patch_embedding, n_patches, (&buffers.patches, &memory.x), ProductEpilogue::Add);
        for layer in 0..depth {
            self.vision_layer(config, layer, &memory)?;
        }
        self.layer_norm(|tensor| names.post_norm(tensor), config, &memory)?;
        let multi_modal_projector = self.linear(&[""], |_, tensor| names.projector(tensor))?;
        self.multiply(
            &multi_modal_projector,
            n_patches,
            (&memory.normed, &buffers.tokens),
            ProductEpilogue::Store,
        );
        Ok(buffers)
    }

    fn layer_buffers(&self, config: SiglipConfig) -> LayerBuffers {
        let SiglipConfig { hidden_size: width, intermediate_size: hidden, n_patches, .. } = config;
        let rows = |label: &str, width: usize| self.buffer(label, BatchUnit::Image, n_patches * width);
        let n_patches = n_patches as u32;
        let span = |image: u32| {
            let first = image * n_patches;
            SequenceSpan { first_query: first, n_queries: n_patches, first_key: first, n_keys: n_patches }
        };
        let spans: Vec<_> = (0..self.capacity.images as u32).map(span).collect();
        LayerBuffers {
            x: rows("x", width),
            normed: rows("normed", width),
            queries: rows("queries", width),
            keys: rows("keys", 2 * width),
            heads: rows("heads", width),
            hidden: rows("hidden", hidden),
            spans: DeviceBuffer::of(self.ops.gpu, "spans", &spans),
        }
    }

    fn vision_layer(
        &mut self,
        config: SiglipConfig,
        layer: usize,
        memory: &LayerBuffers,
    ) -> Result<(), LoadGpuError> {
        let SiglipConfig { hidden_size: width, num_attention_heads: n_heads, n_patches, .. } = config;
        let names = self.source.names;
        let name = |module: &str, tensor: &str| {
            names.layer(LayerStack::Vision, layer, &format!("{module}.{tensor}"))
        };
        let LayerBuffers { x, normed, queries, keys, heads, hidden, spans } = memory;
        self.layer_norm(|tensor| name("layer_norm1", tensor), config, memory)?;
        let weights = self.linear(&["self_attn.q_proj"], name)?;
        self.multiply(&weights, n_patches, (normed, queries), ProductEpilogue::Store);
        let weights = self.linear(&["self_attn.k_proj", "self_attn.v_proj"], name)?;
        self.multiply(&weights, n_patches, (normed, keys), ProductEpilogue::Store);
        let shape = SequenceShape {
            n_heads,
            head_width: width / n_heads,
            shares_keys: false,
            max_queries: n_patches,
            suffix: 0,
        };
        self.attend(shape, SequenceInput { queries, prefix: keys, suffix: keys, spans }, heads)?;
        let weights = self.linear(&["self_attn.out_proj"], name)?;
        self.multiply(&weights, n_patches, (heads, x), ProductEpilogue::Add);
        self.layer_norm(|tensor| name("layer_norm2", tensor), config, memory)?;
        let weights = self.linear(&["mlp.fc1"], name)?;
        self.multiply(&weights, n_patches, (normed, hidden), ProductEpilogue::Gelu);
        let weights = self.linear(&["mlp.fc2"], name)?;
        self.multiply(&weights, n_patches, (hidden, x), ProductEpilogue::Add);
        Ok(())
    }

    /// Adds a layer normalisation from `x` to `normed`.
    fn layer_norm(
        &mut self,
        name: impl Fn(&str) -> String,
        config: SiglipConfig,
        memory: &LayerBuffers,
    ) -> Result<(), LoadGpuError> {
        let scale = self.constant("scale", &self.vector(&name("weight"))?);
        let shift = self.constant("shift", &self.vector(&name("bias"))?);
        let (norm, shape) = (RowNorm::Layer(EPSILON), (config.n_patches, config.hidden_size));
        let step = self.ops.normalise(norm, shape, &memory.x, (&scale, &shift), &memory.normed);
        self.push(step);
        Ok(())
    }

    /// Adds an attention.
    pub(crate) fn attend(
        &mut self,
        shape: SequenceShape,
        input: SequenceInput<'_>,
        out: &DeviceBuffer,
    ) -> Result<(), LoadGpuError> {
        let step = self.ops.sequence_attention(shape, input, out);
        let width = shape.head_width;
        let too_wide = || {
            let expected = format!("expected at most {MAX_HEAD_WIDTH}");
            self.ops.gpu.error(&format!("the width of an attention head is {width}, {expected}"))
        };
        let step = step.ok_or_else(too_wide)?;
        self.push(step);
        Ok(())
    }
}
