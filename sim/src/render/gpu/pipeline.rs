//! The passes that render a chunk of views, and their buffers.

use super::adapter::AdapterKind;
use super::assets::Assets;
use super::batch::ViewBatch;
use super::compute::ComputeVisibility;
use super::device::Gpu;
use super::growable_buffer::GrowableBuffer;
use super::raster::RasterVisibility;
use super::shading::{ShadingPass, VisibilityResult};
use super::{GpuOptions, VisibilityMethod, samples_per_axis};
use crate::render::View;

/// Buffers that all passes read.
pub(super) struct SharedBuffers {
    pub(super) views: GrowableBuffer,
    pub(super) instances: GrowableBuffer,
    pub(super) assets: Assets,
}

/// The visibility and shading passes, with the batch that is being prepared.
pub(super) struct ImagePipeline {
    pub(super) shared: SharedBuffers,
    batch: ViewBatch,
    visibility: VisibilityPass,
    shading: ShadingPass,
}

/// The visibility pass, by method.
enum VisibilityPass {
    Raster(RasterVisibility),
    Compute(ComputeVisibility),
}

impl ImagePipeline {
    /// Creates the pipelines and minimal buffers.
    pub(super) fn new(
        gpu: &Gpu,
        kind: AdapterKind,
        visibility: VisibilityMethod,
        options: &GpuOptions,
    ) -> Self {
        let samples_per_axis = samples_per_axis(options.samples);
        let pass = match visibility {
            VisibilityMethod::Raster => VisibilityPass::Raster(RasterVisibility::new(gpu, samples_per_axis)),
            VisibilityMethod::Compute => {
                VisibilityPass::Compute(ComputeVisibility::new(gpu, samples_per_axis, kind))
            }
        };
        let none = wgpu::BufferUsages::empty();
        let shared = SharedBuffers {
            views: GrowableBuffer::new(gpu, "views", none),
            instances: GrowableBuffer::new(gpu, "instances", none),
            assets: Assets::new(gpu),
        };
        Self {
            shading: ShadingPass::new(gpu, &pass.result(), samples_per_axis),
            shared,
            batch: ViewBatch::new(),
            visibility: pass,
        }
    }

    /// Begins a call of the renderer, which consists of several chunks.
    pub(super) fn begin_batch(&mut self) {
        self.shared.assets.begin_batch();
    }

    /// Uploads views and encodes the commands that render them. The images are stored consecutively in the
    /// returned buffer.
    pub(super) fn encode(
        &mut self,
        gpu: &Gpu,
        views: &[View<'_>],
        encoder: &mut wgpu::CommandEncoder,
    ) -> &wgpu::Buffer {
        let Self { shared, batch, visibility, shading } = self;
        shared.assets.evict_if_full(gpu);
        batch.fill(views, &mut shared.assets);
        let mut stale = shared.assets.upload(gpu);
        stale |= visibility.reserve(gpu, batch);
        stale |= shared.views.write(gpu, &batch.views);
        stale |= shared.instances.write(gpu, &batch.instances);
        shading.prepare(gpu, u64::from(batch.n_pixels) * 3, &visibility.result(), shared, stale);
        let draw_lists = [&batch.images, &batch.shadow_maps];
        match visibility {
            VisibilityPass::Raster(raster) => {
                raster.upload(gpu, draw_lists, shared, stale);
                raster.encode(encoder, batch, shared);
            }
            VisibilityPass::Compute(compute) => {
                compute.upload(gpu, draw_lists, shared, stale);
                compute.encode(encoder);
            }
        }
        shading.encode(encoder, batch.n_images, batch.max_side);
        &shading.images.buffer
    }
}

impl VisibilityPass {
    fn result(&self) -> VisibilityResult<'_> {
        match self {
            Self::Raster(raster) => VisibilityResult::Textures(raster.result()),
            Self::Compute(compute) => VisibilityResult::Buffers(compute.result()),
        }
    }

    /// Reserves space for a batch. Returns `true` if a buffer or texture was reallocated.
    fn reserve(&mut self, gpu: &Gpu, batch: &ViewBatch) -> bool {
        match self {
            Self::Raster(raster) => raster.reserve(gpu, batch),
            Self::Compute(compute) => compute.reserve(gpu, batch),
        }
    }
}
