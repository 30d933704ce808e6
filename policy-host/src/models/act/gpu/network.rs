//! A network on a device: its buffers and steps, and the computation of a batch.

use ipc_types::ImageSizes;

use super::backbone;
use super::layers::StepList;
use crate::formats::scaling::ShiftScale;
use crate::models::act::architecture::Architecture;
use crate::models::act::checkpoint::StoredNetwork;
use crate::models::act::leading::LeadingTokens;
use crate::models::act::model::positions;
use crate::nn::gpu::ops::{DeviceMaps, OpBuilder, ProductEpilogue};
use crate::nn::gpu::steps::{NetworkStep, StepRun};
use crate::nn::gpu::transfer::{BatchArray, BatchInFlight, BatchQueue, UnitCounter};
use crate::nn::gpu::{DeviceBuffer, GpuDevice, GpuError, KernelCache};

/// Largest number of samples that are computed at a time.
const MAX_SAMPLES: usize = 32;

/// An ACT network on a device.
#[derive(Debug)]
pub(crate) struct GpuActNetwork {
    pub(crate) architecture: Architecture,
    pub(crate) leading: LeadingTokens,
    action: Option<ShiftScale>,
    /// Counts samples.
    queue: BatchQueue<1>,
    n_cameras: usize,
    capacity: usize,
    /// Words of a sample in `first_tokens`.
    n_leading_words: usize,
    /// Inputs of the next batch: tokens before those of the images `[n, n_leading, d]`, and 1 for samples
    /// with an instruction.
    tokens: Vec<f32>,
    is_present: Vec<u32>,
    /// Chunk `[horizon, action_dim]` of the current sample.
    chunk: Vec<f32>,
}

impl GpuActNetwork {
    /// Uploads a checked state dict and prepares all steps.
    ///
    /// # Errors
    /// If the device cannot hold a single sample, or fails.
    pub(crate) fn new(gpu: &GpuDevice, stored: &StoredNetwork, sizes: ImageSizes) -> Result<Self, GpuError> {
        let StoredNetwork { architecture, normalisation, state_dict, mapping, .. } = stored;
        let n_tokens = architecture.max_tokens();
        let (width, horizon) = (architecture.hidden_dim, architecture.horizon);
        let n_leading = n_tokens - architecture.n_image_tokens();
        let capacity = capacity(gpu, architecture)?;
        let batch = DeviceBuffer::uniform(gpu, "batch");
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
        let cameras = list.backbone(normalisation, (mapping, sizes), n_leading, &tokens);
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
        let run = StepRun { unit: 0, steps: list.steps };
        let capacity = capacity.min(run.max_units());
        if capacity == 0 {
            return Err(gpu.error("a sample needs more workgroups than it allows"));
        }
        let size = |camera: &usize| sizes.of_camera(mapping.morphology, *camera);
        let image_words = mapping.cameras.iter().map(|camera| size(camera).n_bytes().div_ceil(4));
        let images = cameras.into_iter().zip(image_words);
        let others = [(first_tokens, n_leading * width), (memory.present, 1)];
        let array = |(buffer, n_words)| BatchArray { buffer, unit: 0, n_words };
        let inputs = images.chain(others).map(array).collect();
        let result = array((actions.buffer, horizon * architecture.action_dim));
        let samples = UnitCounter { count: batch, capacity };
        Ok(Self {
            architecture: architecture.clone(),
            leading: LeadingTokens::new(architecture, normalisation, state_dict),
            action: normalisation.action.clone(),
            queue: BatchQueue::new([samples], inputs, vec![run], result),
            n_cameras: mapping.cameras.len(),
            capacity,
            n_leading_words: n_leading * width,
            tokens: vec![0.0; capacity * n_leading * width],
            is_present: vec![0; capacity],
            chunk: vec![0.0; horizon * architecture.action_dim],
        })
    }

    /// Returns the largest number of samples of [`forward`](Self::forward).
    pub(crate) fn capacity(&self) -> usize {
        self.capacity
    }

    /// Sets the inputs of a sample of the next batch. `state` is normalised in place; `instruction` is empty
    /// or a token.
    pub(crate) fn set_inputs(&mut self, sample: usize, state: &mut [f32], instruction: &[f32]) {
        let tokens = &mut self.tokens[sample * self.n_leading_words..][..self.n_leading_words];
        // The token of an absent instruction is zero, and attention ignores it.
        self.leading.write(state, instruction, tokens).fill(0.0);
        let is_complete = self.architecture.instruction.is_none() || !instruction.is_empty();
        self.is_present[sample] = u32::from(is_complete);
    }

    /// Submits a batch whose inputs were set. `image(sample, camera)` returns bytes `[h, w, 3]`.
    ///
    /// # Errors
    /// If the device fails.
    pub(crate) fn submit<'a>(
        &mut self,
        gpu: &GpuDevice,
        n_samples: usize,
        image: impl Fn(usize, usize) -> &'a [u8] + Sync,
    ) -> Result<BatchInFlight, GpuError> {
        let Self { queue, n_cameras, n_leading_words, tokens, is_present, .. } = self;
        let bytes = |input: usize, sample: usize| match input.checked_sub(*n_cameras) {
            None => image(sample, input),
            Some(0) => bytemuck::cast_slice(&tokens[sample * *n_leading_words..][..*n_leading_words]),
            Some(_) => bytemuck::bytes_of(&is_present[sample]),
        };
        queue.submit(gpu, [n_samples], &bytes)
    }

    /// Waits for a batch and passes each chunk, `[horizon, action_dim]` in the units of the environment, to
    /// `accept`.
    ///
    /// # Errors
    /// If the device fails.
    pub(crate) fn collect(
        &mut self,
        gpu: &GpuDevice,
        batch: BatchInFlight,
        mut accept: impl FnMut(usize, &[f32]),
    ) -> Result<(), GpuError> {
        let (chunk, action) = (&mut self.chunk, &self.action);
        self.queue.collect(gpu, batch, |actions| {
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
    match (gpu.max_buffer_bytes() / n_bytes).min(MAX_SAMPLES as u64) {
        0 => {
            let limit = gpu.max_buffer_bytes();
            Err(gpu.error(&format!("a sample needs a buffer of {n_bytes} bytes, but it allows {limit}")))
        }
        capacity => Ok(capacity as usize),
    }
}
