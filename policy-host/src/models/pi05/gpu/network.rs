//! A network on a device: its buffers and steps, and the computation of a batch.

use std::sync::Arc;

use bytemuck::cast_slice;

use super::expert::ExpertInput;
use super::runs::{BatchUnit, N_UNITS, RunBuilder, UnitCounts, unreadable};
use super::{gemma, vision};
use crate::models::LoadGpuError;
use crate::models::pi05::architecture::Pi05Architecture;
use crate::models::pi05::checkpoint::names::Pi05Names;
use crate::models::pi05::expert::{TimePeriods, modulations};
use crate::models::pi05::gemma::embed;
use crate::models::pi05::layers::LayerSource;
use crate::models::pi05::model::{Pi05Input, Pi05Options, times};
use crate::models::pi05::siglip::{PATCH_VALUES, unfold};
use crate::nn::gpu::sequences::SequenceSpan;
use crate::nn::gpu::steps::StepRun;
use crate::nn::gpu::transfer::{BatchArray, BatchInFlight, BatchQueue, UnitCounter};
use crate::nn::gpu::{DeviceBuffer, GpuDevice, GpuError};
use crate::nn::rotary::Rotary;
use crate::weights::{StoredTensor, TensorFolder};

/// Largest number of samples that are computed at a time.
const MAX_SAMPLES: usize = 8;

/// A π0.5 network on a device.
#[derive(Debug)]
pub struct GpuPi05Network {
    gpu: Arc<GpuDevice>,
    architecture: Pi05Architecture,
    /// Token embedding `[vocabulary, width]`, which stays in the file.
    embed_tokens: StoredTensor,
    /// Counts each [`BatchUnit`].
    queue: BatchQueue<N_UNITS>,
    /// Largest batch in samples.
    capacity: usize,
}

/// Rows of a batch as the kernels read them.
#[derive(Default)]
struct BatchRows {
    /// Embeddings of all prompts' tokens `[tokens, width]`.
    text: Vec<f32>,
    /// Source of every row of the prefixes.
    index: Vec<u32>,
    prefix_positions: Vec<u32>,
    expert_positions: Vec<u32>,
    prefix_spans: Vec<SequenceSpan>,
    expert_spans: Vec<SequenceSpan>,
}

impl GpuPi05Network {
    /// Uploads all weights and prepares all steps, for samples of `n_images` images.
    ///
    /// # Errors
    /// If a tensor cannot be read, or the device cannot hold the network and a single sample, or fails.
    pub fn load(
        gpu: &Arc<GpuDevice>,
        (tensors, names): (&TensorFolder, &Pi05Names),
        architecture: Pi05Architecture,
        options: Pi05Options,
        n_images: usize,
    ) -> Result<Self, LoadGpuError> {
        let source = LayerSource { tensors, names, precision: options.precision };
        Self::build(gpu, source, architecture, options, n_images).map_err(|error| match error {
            // Vulkan does not tell in advance how much memory is free.
            LoadGpuError::Device(GpuError::Device { name, message }) => {
                let n_mib = uploaded_bytes(source, &architecture) >> 20;
                let message = format!("{message}; the network uploads {n_mib} MiB of weights");
                GpuError::Device { name, message }.into()
            }
            other => other,
        })
    }

    fn build(
        gpu: &Arc<GpuDevice>,
        source: LayerSource<'_>,
        architecture: Pi05Architecture,
        options: Pi05Options,
        n_images: usize,
    ) -> Result<Self, LoadGpuError> {
        let Pi05Architecture { vision, prefix, expert, horizon, action_width, .. } = architecture;
        let samples = capacity(gpu, &architecture, (n_images, options.max_prefix))?;
        let max_prompt = options.max_prefix - n_images * vision.n_patches;
        let per_sample =
            UnitCounts { images: n_images, tokens: max_prompt, rows: options.max_prefix, samples: 1 };
        let counts = [(); N_UNITS].map(|()| DeviceBuffer::batch(gpu));
        let mut build = RunBuilder::new(gpu, source, &counts, per_sample.times(samples));

        let images = build.vision(vision, prefix.hidden_size)?;
        let prefix = build.stack_buffers(prefix, BatchUnit::Row, 1);
        let width = prefix.config.hidden_size;
        let text = build.buffer("text", BatchUnit::Token, width);
        let index = build.buffer("index", BatchUnit::Row, 1);
        build.count(BatchUnit::Row);
        let step = build.ops.gather(width, [&images.tokens, &text], &index, &prefix.x);
        build.push(step);
        let rotary = Rotary::new(prefix.config.head_dim, options.max_prefix + horizon);
        let angles = build.constant("angles", rotary.angles().as_flattened());
        let cache = build.prefill(&prefix, options.max_prefix, &angles)?;
        let (min, max) = options.periods;
        let modulations = modulations(source, expert, &times(options.n_steps), TimePeriods { min, max });
        let expert = build.stack_buffers(expert, BatchUnit::Sample, horizon);
        let actions = build.buffer("actions", BatchUnit::Sample, horizon * action_width);
        let input = ExpertInput {
            actions: &actions,
            action_width,
            cache: &cache,
            angles: &angles,
            modulations: &modulations.map_err(unreadable)?,
        };
        build.expert(&expert, &input)?;
        gpu.finish_uploads()?;
        let runs = build.runs;
        let capacity = runs.iter().map(|run| max_samples(run, per_sample)).fold(samples, usize::min);
        if capacity == 0 {
            return Err(gpu.error("a sample needs more workgroups than it allows").into());
        }
        let capacities = per_sample.times(capacity).by_unit();
        let counters = std::array::from_fn(|unit| UnitCounter {
            count: counts[unit].clone(),
            capacity: capacities[unit],
        });
        let array = |(buffer, unit, n_words)| BatchArray { buffer, unit: unit as usize, n_words };
        // The order of the arrays in `submit`.
        let inputs = [
            (images.patches, BatchUnit::Image, vision.n_patches * PATCH_VALUES),
            (text, BatchUnit::Token, width),
            (index, BatchUnit::Row, 1),
            (prefix.positions, BatchUnit::Row, 1),
            (prefix.spans, BatchUnit::Sample, 4),
            (expert.positions, BatchUnit::Sample, horizon),
            (expert.spans, BatchUnit::Sample, 4),
            (actions.clone(), BatchUnit::Sample, horizon * action_width),
        ];
        let result = (actions, BatchUnit::Sample, horizon * action_width);
        Ok(Self {
            embed_tokens: source.tensor(&source.names.embedding()).map_err(unreadable)?,
            gpu: Arc::clone(gpu),
            architecture,
            queue: BatchQueue::new(counters, inputs.map(array).into(), runs, array(result)),
            capacity,
        })
    }

    /// Returns the largest number of samples of [`submit`](Self::submit).
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Uploads a batch and submits it. `noise [n, horizon, action_width]` is where the action chunks start.
    ///
    /// # Errors
    /// If the device fails.
    ///
    /// # Panics
    /// If the lengths do not match, or there is no sample or more than the capacity.
    pub fn submit(&mut self, input: Pi05Input<'_>, noise: &[f32]) -> Result<BatchInFlight, GpuError> {
        let Pi05Architecture { vision, prefix, horizon, action_width, .. } = self.architecture;
        let samples = input.samples.len();
        assert_eq!(noise.len(), samples * horizon * action_width, "noise of every sample");
        let patches = unfold(input.images, vision.n_patches.isqrt());
        let rows = self.rows(&input);
        let counts = UnitCounts {
            images: patches.len() / (vision.n_patches * PATCH_VALUES),
            tokens: rows.text.len() / prefix.hidden_size,
            rows: rows.index.len(),
            samples,
        };
        let arrays: [(&[u8], usize); _] = [
            (cast_slice(&patches), counts.images),
            (cast_slice(&rows.text), counts.tokens),
            (cast_slice(&rows.index), counts.rows),
            (cast_slice(&rows.prefix_positions), counts.rows),
            (cast_slice(&rows.prefix_spans), samples),
            (cast_slice(&rows.expert_positions), samples),
            (cast_slice(&rows.expert_spans), samples),
            (cast_slice(noise), samples),
        ];
        let bytes = |input: usize, unit: usize| {
            let (array, n_units) = arrays[input];
            let n_bytes = array.len() / n_units;
            &array[unit * n_bytes..][..n_bytes]
        };
        self.queue.submit(&self.gpu, counts.by_unit(), &bytes)
    }

    /// Waits for a batch and passes its action chunks `[n, horizon, action_width]` to `read`.
    ///
    /// # Errors
    /// If the device fails.
    pub fn collect(&mut self, batch: BatchInFlight, read: impl FnOnce(&[f32])) -> Result<(), GpuError> {
        self.queue.collect(&self.gpu, batch, read)
    }

    /// Denoises `actions [n, horizon, action_width]` in place, one chunk per sample. They hold the noise at
    /// first.
    ///
    /// # Errors
    /// If the device fails.
    ///
    /// # Panics
    /// Like [`submit`](Self::submit).
    pub fn sample(&mut self, input: Pi05Input<'_>, actions: &mut [f32]) -> Result<(), GpuError> {
        let batch = self.submit(input, actions)?;
        self.collect(batch, |found| actions.copy_from_slice(found))
    }

    /// Lays out the prefixes of a batch: the tokens of each sample's images, then its prompt.
    fn rows(&self, input: &Pi05Input<'_>) -> BatchRows {
        let Pi05Architecture { vision, prefix, horizon, .. } = self.architecture;
        let (horizon, mut rows) = (horizon as u32, BatchRows::default());
        let mut n_tokens = 0;
        for (sample, tokens) in (0..).zip(input.samples) {
            let first = rows.index.len() as u32;
            for &image in &tokens.images {
                // An even index selects a row of the images, an odd one a row of the text.
                let first = image * vision.n_patches;
                rows.index.extend((first..first + vision.n_patches).map(|row| 2 * row as u32));
            }
            for &token in &tokens.prompt {
                rows.index.push(2 * n_tokens + 1);
                n_tokens += 1;
                let start = rows.text.len();
                rows.text.resize(start + prefix.hidden_size, 0.0);
                embed(&self.embed_tokens, token, &mut rows.text[start..]);
            }
            let length = rows.index.len() as u32 - first;
            rows.prefix_positions.extend(0..length);
            rows.expert_positions.extend(length..length + horizon);
            let keys =
                SequenceSpan { first_query: first, n_queries: length, first_key: first, n_keys: length };
            rows.prefix_spans.push(keys);
            let queries = SequenceSpan { first_query: sample * horizon, n_queries: horizon, ..keys };
            rows.expert_spans.push(queries);
        }
        rows
    }
}

/// Returns the number of samples that a run can take at a time.
fn max_samples(run: &StepRun, per_sample: UnitCounts) -> usize {
    run.max_units().checked_div(per_sample.by_unit()[run.unit]).unwrap_or(usize::MAX)
}

/// Returns the size of all weights but the token embedding, which stays in the file.
fn uploaded_bytes(source: LayerSource<'_>, architecture: &Pi05Architecture) -> u64 {
    let embedding = source.names.embedding();
    let specs = architecture.tensor_specs(source.names);
    let uploaded = specs.iter().filter(|spec| spec.name != embedding);
    let n_bytes = |name: &str| source.tensor(name).map_or(0, |tensor| tensor.bytes().len() as u64);
    uploaded.map(|spec| n_bytes(&spec.name)).sum()
}

/// Returns the number of samples for which every buffer fits the device.
fn capacity(
    gpu: &GpuDevice,
    architecture: &Pi05Architecture,
    (n_images, max_prefix): (usize, usize),
) -> Result<usize, GpuError> {
    let Pi05Architecture { vision, prefix, expert, horizon, action_width, .. } = *architecture;
    let n_words = [
        n_images * vision::max_words(vision, prefix.hidden_size),
        max_prefix * gemma::max_words(prefix),
        horizon * gemma::max_words(expert).max(action_width),
    ];
    let n_bytes = n_words.into_iter().fold(0, usize::max) as u64 * 4;
    match (gpu.max_binding() / n_bytes).min(MAX_SAMPLES as u64) {
        0 => {
            let limit = gpu.max_binding();
            Err(gpu.error(&format!("a sample needs a buffer of {n_bytes} bytes, but it allows {limit}")))
        }
        capacity => Ok(capacity as usize),
    }
}
