//! A network on a device: its buffers and steps, and the computation of a batch.

use super::layers::StepList;
use super::{backbone, camera_size};
use crate::act::architecture::Architecture;
use crate::act::leading::LeadingTokens;
use crate::act::model::positions;
use crate::act::normalise::ShiftScale;
use crate::act::stored::StoredNetwork;
use crate::nn::gpu::ops::{DeviceMaps, OpBuilder, ProductEpilogue};
use crate::nn::gpu::readback::{BatchReadback, NetworkStep};
use crate::nn::gpu::{DeviceBuffer, GpuDevice, GpuError, KernelCache};

/// Largest number of samples that are computed at a time. Not yet tuned on a GPU.
const MAX_SAMPLES: usize = 32;

/// An ACT network on a device.
#[derive(Debug)]
pub(super) struct GpuNetwork {
    pub(super) architecture: Architecture,
    pub(super) leading: LeadingTokens,
    action: Option<ShiftScale>,
    batch: DeviceBuffer,
    /// Bytes of each camera's images, and words per image.
    cameras: Vec<(DeviceBuffer, usize)>,
    /// Tokens before those of the images, `[n, n_leading, d]`.
    first_tokens: DeviceBuffer,
    present: DeviceBuffer,
    actions: DeviceBuffer,
    readback: BatchReadback,
    steps: Vec<NetworkStep>,
    capacity: usize,
    /// Words of a sample in `first_tokens`.
    n_leading_words: usize,
    /// Inputs of the current batch, to be uploaded to `first_tokens` and `present`.
    tokens: Vec<f32>,
    is_present: Vec<u32>,
    /// Chunk `[horizon, action_dim]` of the current sample.
    chunk: Vec<f32>,
}

impl GpuNetwork {
    /// Uploads a checked state dict and prepares all steps.
    ///
    /// # Errors
    /// If the device cannot hold a single sample, or fails.
    pub(super) fn new(gpu: &GpuDevice, stored: &StoredNetwork) -> Result<Self, GpuError> {
        let StoredNetwork { architecture, normalisation, state_dict, mapping, .. } = stored;
        let n_tokens = architecture.max_tokens();
        let (width, horizon) = (architecture.hidden_dim, architecture.horizon);
        let n_leading = n_tokens - architecture.n_image_tokens();
        let capacity = capacity(gpu, architecture)?;
        let batch = DeviceBuffer::batch(gpu);
        let ops = OpBuilder { gpu, kernels: KernelCache::default(), batch: &batch };
        let mut list = StepList { ops, architecture, state_dict, capacity, steps: Vec::new() };

        let tokens = list.rows("tokens", n_tokens, width);
        let target = list.rows("target", horizon, width);
        let first_tokens = list.buffer("first tokens", n_leading * width);
        let optional = architecture.instruction.is_some().then(|| n_leading - 1);
        let memory = list.layer_memory(n_tokens.max(horizon), optional);
        let query_positions = list.tensor("query_embed.weight");
        let [positions, _] = positions(architecture, state_dict);
        let positions = DeviceBuffer::of(gpu, "positions", &positions);
        let constant = list.constant_target(&target, &query_positions, &memory)?;
        list.steps.push(NetworkStep::Copy {
            from: (first_tokens.clone(), n_leading * width),
            to: (tokens.buffer.clone(), n_tokens * width),
            n_words: n_leading * width,
        });
        let cameras = list.backbone(normalisation, mapping, n_leading, &tokens);
        for layer in 0..architecture.enc_layers {
            let name = format!("transformer.encoder.layers.{layer}");
            list.encoder_layer(&name, &tokens, &positions, &memory)?;
        }
        // The encoder has used the same memory.
        list.steps.extend(constant);
        for layer in 0..architecture.dec_layers {
            let name = format!("transformer.decoder.layers.{layer}");
            if layer > 0 {
                list.attend_to_target(&name, &target, &query_positions, &memory)?;
            }
            list.attend_to_memory(&name, &target, (&tokens, &positions), &memory)?;
        }
        list.layer_norm("transformer.decoder.norm", &target);
        let actions = list.rows("actions", horizon, architecture.action_dim);
        let head = list.weights("action_head");
        list.linear(&head, (&target, None), &actions, ProductEpilogue::Store);
        gpu.check()?;
        let steps = list.steps;
        let capacity = steps.iter().map(NetworkStep::max_samples).fold(capacity, usize::min);
        if capacity == 0 {
            return Err(gpu.error("a sample needs more workgroups than it allows"));
        }
        Ok(Self {
            architecture: architecture.clone(),
            leading: LeadingTokens::new(architecture, normalisation, state_dict),
            action: normalisation.action.clone(),
            cameras: cameras
                .into_iter()
                .zip(&mapping.cameras)
                .map(|(bytes, camera)| (bytes, (camera_size(*camera).n_pixels() * 3).div_ceil(4)))
                .collect(),
            first_tokens,
            present: memory.present,
            actions: actions.buffer,
            readback: BatchReadback::new(gpu, capacity * horizon * architecture.action_dim),
            steps,
            capacity,
            n_leading_words: n_leading * width,
            tokens: vec![0.0; capacity * n_leading * width],
            is_present: vec![0; capacity],
            chunk: vec![0.0; horizon * architecture.action_dim],
            batch,
        })
    }

    /// Returns the largest number of samples of [`forward`](Self::forward).
    pub(super) fn capacity(&self) -> usize {
        self.capacity
    }

    /// Sets the inputs of a sample of the next batch. `state` is normalised in place; `instruction` is empty
    /// or a token.
    pub(super) fn set_inputs(&mut self, sample: usize, state: &mut [f32], instruction: &[f32]) {
        let tokens = &mut self.tokens[sample * self.n_leading_words..][..self.n_leading_words];
        // The token of an absent instruction is zero, and attention ignores it.
        self.leading.write(state, instruction, tokens).fill(0.0);
        let is_complete = self.architecture.instruction.is_none() || !instruction.is_empty();
        self.is_present[sample] = u32::from(is_complete);
    }

    /// Computes the chunks of a batch, whose inputs were set, and passes each, `[horizon, action_dim]` in the
    /// units of the environment, to `accept`. `image(sample, camera)` returns bytes `[h, w, 3]`.
    ///
    /// # Errors
    /// If the device fails.
    pub(super) fn forward<'a>(
        &mut self,
        gpu: &GpuDevice,
        n_samples: usize,
        image: impl Fn(usize, usize) -> &'a [u8],
        mut accept: impl FnMut(usize, &[f32]),
    ) -> Result<(), GpuError> {
        self.batch.write(gpu, 0, &[n_samples as u32]);
        for (camera, (buffer, n_words)) in self.cameras.iter().enumerate() {
            for sample in 0..n_samples {
                buffer.write(gpu, (sample * n_words * 4) as u64, image(sample, camera));
            }
        }
        self.first_tokens.write(gpu, 0, &self.tokens[..n_samples * self.n_leading_words]);
        self.present.write(gpu, 0, &self.is_present[..n_samples]);
        let (chunk, action) = (&mut self.chunk, &self.action);
        let result = (&self.actions, n_samples * chunk.len());
        let pending = self.readback.submit(gpu, &self.steps, n_samples, result);
        self.readback.collect(gpu, &pending, |actions| {
            for (sample, actions) in actions.chunks_exact(chunk.len()).enumerate() {
                chunk.copy_from_slice(actions);
                if let Some(norm) = action {
                    norm.restore(chunk);
                }
                accept(sample, chunk);
            }
        })
    }
}

/// Returns the number of samples for which every buffer fits the device.
fn capacity(gpu: &GpuDevice, architecture: &Architecture) -> Result<usize, GpuError> {
    let rows = architecture.max_tokens().max(architecture.horizon);
    let transformer = rows * architecture.dim_feedforward.max(architecture.hidden_dim);
    let groups = architecture.cameras.chunk_by(|a, b| a == b).map(|group| {
        let (height, width) = (group[0].height, group[0].width);
        let maps = DeviceMaps { images: group.len(), height, width, channels: 3 };
        backbone::max_words(maps, architecture.backbone.width)
    });
    let n_bytes = groups.fold(transformer, usize::max) as u64 * 4;
    match (gpu.max_binding() / n_bytes).min(MAX_SAMPLES as u64) {
        0 => {
            let limit = gpu.max_binding();
            Err(gpu.error(&format!("a sample needs a buffer of {n_bytes} bytes, but it allows {limit}")))
        }
        capacity => Ok(capacity as usize),
    }
}
