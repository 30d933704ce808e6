//! A network on a device: its buffers and steps, and the computation of a batch.

use super::layers::StepList;
use super::transformer::TooManyTokens;
use super::{backbone, camera_size};
use crate::act::architecture::Architecture;
use crate::act::leading::LeadingTokens;
use crate::act::model::positions;
use crate::act::normalise::{Normalisation, ShiftScale};
use crate::checkpoint::ObservationMapping;
use crate::nn::gpu::ops::{DeviceMaps, OpBuilder, ProductEpilogue};
use crate::nn::gpu::readback::{BatchReadback, NetworkStep};
use crate::nn::gpu::{DeviceBuffer, GpuDevice, GpuError, KernelCache};
use crate::weights::StateDict;

/// Largest number of samples in a batch. More of them fill no GPU better.
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
    n_leading: usize,
}

/// Inputs of a sample apart from its images.
#[derive(Clone, Debug)]
pub(super) struct SampleInputs {
    /// Tokens before those of the images, `[n_leading, d]`; zeros for an instruction that is absent.
    pub(super) tokens: Vec<f32>,
    /// `true` if the sample has all of them.
    pub(super) is_complete: bool,
}

impl GpuNetwork {
    /// Uploads a checked state dict and prepares all steps.
    ///
    /// # Errors
    /// If the device cannot hold a single sample, or fails.
    pub(super) fn new(
        gpu: &GpuDevice,
        architecture: &Architecture,
        normalisation: &Normalisation,
        state_dict: &StateDict,
        mapping: &ObservationMapping,
    ) -> Result<Self, GpuError> {
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
        let too_many = |TooManyTokens(n)| device_error(gpu, &format!("{n} tokens are too many for it"));

        let constant = list.constant_target(&target, &query_positions, &memory).map_err(too_many)??;
        list.steps.push(NetworkStep::Copy {
            from: (first_tokens.clone(), n_leading * width),
            to: (tokens.buffer.clone(), n_tokens * width),
            n_words: n_leading * width,
        });
        let cameras = list.backbone(normalisation, mapping, n_leading, &tokens);
        for layer in 0..architecture.enc_layers {
            let name = format!("transformer.encoder.layers.{layer}");
            list.encoder_layer(&name, &tokens, &positions, &memory).map_err(too_many)?;
        }
        // The encoder has used the same memory.
        list.steps.extend(constant);
        for layer in 0..architecture.dec_layers {
            let name = format!("transformer.decoder.layers.{layer}");
            if layer > 0 {
                list.attend_to_target(&name, &target, &query_positions, &memory).map_err(too_many)?;
            }
            list.attend_to_memory(&name, &target, (&tokens, &positions), &memory).map_err(too_many)?;
        }
        list.layer_norm("transformer.decoder.norm", &target);
        let actions = list.rows("actions", horizon, architecture.action_dim);
        let head = list.weights("action_head");
        list.linear(&head, (&target, None), &actions, ProductEpilogue::Store);
        gpu.check()?;
        let steps = list.steps;
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
            n_leading,
            batch,
        })
    }

    /// Returns the largest number of samples of [`forward`](Self::forward).
    pub(super) fn capacity(&self) -> usize {
        self.capacity
    }

    /// Returns the inputs of a sample. `state` is normalised in place; `instruction` is empty or a token.
    pub(super) fn inputs(&self, state: &mut [f32], instruction: &[f32]) -> SampleInputs {
        let mut tokens = vec![0.0; self.n_leading * self.architecture.hidden_dim];
        self.leading.write(state, instruction, &mut tokens);
        let is_complete = self.architecture.instruction.is_none() || !instruction.is_empty();
        SampleInputs { tokens, is_complete }
    }

    /// Computes the chunks of a batch and passes each, `[horizon, action_dim]` in the units of the
    /// environment, to `accept`. `image(sample, camera)` returns bytes `[h, w, 3]`.
    ///
    /// # Errors
    /// If the device fails.
    pub(super) fn forward<'a>(
        &self,
        gpu: &GpuDevice,
        inputs: &[SampleInputs],
        image: impl Fn(usize, usize) -> &'a [u8],
        mut accept: impl FnMut(usize, &mut [f32]),
    ) -> Result<(), GpuError> {
        let n_samples = inputs.len();
        self.batch.write(gpu, 0, &[n_samples as u32]);
        for (camera, (buffer, n_words)) in self.cameras.iter().enumerate() {
            for sample in 0..n_samples {
                buffer.write(gpu, (sample * n_words * 4) as u64, image(sample, camera));
            }
        }
        let tokens: Vec<f32> = inputs.iter().flat_map(|inputs| &inputs.tokens).copied().collect();
        self.first_tokens.write(gpu, 0, &tokens);
        let present: Vec<u32> = inputs.iter().map(|inputs| u32::from(inputs.is_complete)).collect();
        self.present.write(gpu, 0, &present);
        let chunk_len = self.architecture.horizon * self.architecture.action_dim;
        let result = (&self.actions, n_samples * chunk_len);
        let pending = self.readback.submit(gpu, &self.steps, n_samples, result);
        self.readback.collect(gpu, &pending, |actions| {
            let mut chunk = vec![0.0; chunk_len];
            for (sample, actions) in actions.chunks_exact(chunk_len).enumerate() {
                chunk.copy_from_slice(actions);
                if let Some(norm) = &self.action {
                    norm.restore(&mut chunk);
                }
                accept(sample, &mut chunk);
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
        0 => Err(device_error(
            gpu,
            &format!("a sample needs a buffer of {n_bytes} bytes, but it allows {} bytes", gpu.max_binding()),
        )),
        capacity => Ok(capacity as usize),
    }
}

fn device_error(gpu: &GpuDevice, message: &str) -> GpuError {
    GpuError::Device { name: gpu.name().to_owned(), message: message.to_owned() }
}
