//! The renderer: chunks of views, rendered and read back in turns.

use std::time::Instant;

use gpu::{AdapterKind, GpuDevice};
use ipc_types::ImageSizes;

use super::device::REQUIREMENTS;
use super::passes::pipeline::ImagePipeline;
use super::readback::Readback;
use crate::Samples;
use crate::renderer::{OpenRendererError, RenderError, Renderer, View, name_with_samples};

/// Breakdown of the time spent in a call of [`Renderer::render`], in s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Timings {
    /// Preparing, uploading and submitting commands.
    pub submit_s: f64,
    /// Waiting for the device.
    pub wait_s: f64,
    /// Copying images to the output slices.
    pub readback_s: f64,
}

/// Renderer that runs on a GPU through Vulkan.
pub struct GpuRenderer {
    pub(crate) pipeline: ImagePipeline,
    readbacks: [Readback; 2],
    timings: Timings,
    samples: Samples,
    pub(crate) gpu: GpuDevice,
}

impl GpuRenderer {
    /// Opens an adapter of a kind by its index among those of the kind, or the first that can render. Images
    /// must not be larger than `sizes`.
    ///
    /// # Errors
    /// If there is none, which lists what was found, if it cannot be opened, or if it has no room for the
    /// images of an env.
    pub fn open(
        kind: AdapterKind,
        index: Option<usize>,
        samples: Samples,
        sizes: ImageSizes,
    ) -> Result<Self, OpenRendererError> {
        let gpu = GpuDevice::open(kind, index, &REQUIREMENTS)?;
        let pipeline = ImagePipeline::new(&gpu, kind, samples, sizes)?;
        // Shader compilation errors are reported at this point.
        gpu.check()?;
        let readback = || Readback::new(pipeline.limits.bytes.images);
        Ok(Self { readbacks: [readback(), readback()], pipeline, timings: Timings::default(), samples, gpu })
    }

    /// Returns the timings of the last call of [`Renderer::render`].
    #[must_use]
    pub fn timings(&self) -> Timings {
        self.timings
    }

    /// Returns the device memory in bytes that chunks of views take at most, whatever the batch. Meshes,
    /// textures and scenes add to it.
    #[must_use]
    pub fn max_chunk_bytes(&self) -> u64 {
        self.pipeline.limits.total_bytes
    }

    /// Returns the largest number of envs that are rendered at a time.
    #[must_use]
    pub fn max_chunk_envs(&self) -> usize {
        self.pipeline.limits.n_envs as usize
    }

    /// Returns the device memory in bytes that chunks of views take now.
    #[must_use]
    pub fn chunk_bytes(&self) -> u64 {
        self.pipeline.chunk_bytes() + self.readbacks.iter().map(Readback::n_bytes).sum::<u64>()
    }

    /// Submits the next chunk of `views`. Returns the number of its views.
    fn submit(&mut self, views: &[View<'_>], chunk_idx: usize) -> Result<usize, RenderError> {
        let start = Instant::now();
        let mut encoder = self.gpu.encoder();
        let (n, images, n_bytes) = self.pipeline.encode(&self.gpu, views, &mut encoder);
        self.readbacks[chunk_idx % 2].submit(&self.gpu, encoder, images, n_bytes);
        self.timings.submit_s += start.elapsed().as_secs_f64();
        self.gpu.check()?;
        Ok(n)
    }

    fn collect(&mut self, views: &mut [View<'_>], chunk_idx: usize) -> Result<(), RenderError> {
        let readback = &mut self.readbacks[chunk_idx % 2];
        let start = Instant::now();
        readback.wait(&self.gpu)?;
        let finished = Instant::now();
        readback.collect(&self.gpu, views)?;
        self.timings.wait_s += (finished - start).as_secs_f64();
        self.timings.readback_s += finished.elapsed().as_secs_f64();
        Ok(())
    }
}

impl Renderer for GpuRenderer {
    fn name(&self) -> String {
        name_with_samples(format!("gpu ({})", self.gpu.name()), self.samples)
    }

    fn identity(&self) -> String {
        self.name()
    }

    fn is_on_device(&self) -> bool {
        true
    }

    fn render(&mut self, views: &mut [View<'_>]) -> Result<(), RenderError> {
        views.iter().for_each(View::check);
        self.timings = Timings::default();
        self.gpu.check()?;
        self.pipeline.begin_batch(views);
        let (mut from, mut previous) = (0, None);
        for chunk_idx in 0.. {
            let n = if from < views.len() { self.submit(&views[from..], chunk_idx)? } else { 0 };
            if let Some(previous) = previous.replace(from..from + n) {
                self.collect(&mut views[previous], chunk_idx - 1)?;
            }
            if n == 0 {
                break;
            }
            from += n;
        }
        Ok(())
    }
}
