//! The passes that render a chunk of views, and their buffers.

use gpu::{AdapterKind, GpuDevice, GrowableBuffer};

use super::assets::Assets;
use super::batch::ViewBatch;
use super::chunk::{ChunkLimits, ChunkSize};
use super::compute::ComputeVisibility;
use super::options::{GpuOptions, VisibilityMethod, samples_per_axis};
use super::placement::PlacementPass;
use super::raster::RasterVisibility;
use super::scenes::ResidentScenes;
use super::shading::{ShadingPass, VisibilityResult};
use super::shared_buffers::SharedBuffers;
use crate::View;

/// All passes, with the chunk that is being prepared.
pub(crate) struct ImagePipeline {
    pub(crate) shared: SharedBuffers,
    pub(crate) limits: ChunkLimits,
    /// Limit for the chunks of the current batch.
    limit: ChunkSize,
    batch: ViewBatch,
    placement: PlacementPass,
    visibility: VisibilityPass,
    shading: ShadingPass,
    samples_per_axis: u32,
}

/// The visibility pass, by method.
enum VisibilityPass {
    Raster(RasterVisibility),
    Compute(ComputeVisibility),
}

impl ImagePipeline {
    /// Creates the pipelines and minimal buffers.
    pub(crate) fn new(
        gpu: &GpuDevice,
        kind: AdapterKind,
        visibility: VisibilityMethod,
        options: &GpuOptions,
    ) -> Self {
        let samples_per_axis = samples_per_axis(options.samples);
        let limits = ChunkLimits::new(gpu, kind, visibility, samples_per_axis);
        let pass = match visibility {
            VisibilityMethod::Raster => {
                VisibilityPass::Raster(RasterVisibility::new(gpu, samples_per_axis, &limits))
            }
            VisibilityMethod::Compute => {
                VisibilityPass::Compute(ComputeVisibility::new(gpu, samples_per_axis, kind, &limits))
            }
        };
        let buffer =
            |label, full_size| GrowableBuffer::new(gpu, label, wgpu::BufferUsages::empty(), full_size);
        let shared = SharedBuffers {
            views: buffer("views", limits.bytes.views),
            poses: buffer("poses", limits.bytes.poses),
            instances: buffer("instances", limits.bytes.instances),
            scenes: ResidentScenes::new(gpu),
            assets: Assets::new(gpu),
        };
        Self {
            shading: ShadingPass::new(gpu, &pass.result(), samples_per_axis, limits.bytes.images),
            placement: PlacementPass::new(gpu, visibility),
            shared,
            limit: limits.largest,
            limits,
            batch: ViewBatch::default(),
            visibility: pass,
            samples_per_axis,
        }
    }

    /// Begins a batch, which consists of several chunks.
    pub(crate) fn begin_batch(&mut self, views: &[View<'_>]) {
        let SharedBuffers { scenes, assets, .. } = &mut self.shared;
        if assets.has_many_meshes() {
            scenes.remove_dropped();
            assets.retain(&scenes.meshes());
        }
        self.limit = self.limits.for_batch(views.iter().map(|view| view.out.len() as u64 / 3).sum());
    }

    /// Uploads the next chunk of `views` and encodes the commands that render it. Returns the number of its
    /// views and the buffer in which their images are stored consecutively.
    pub(crate) fn encode(
        &mut self,
        gpu: &GpuDevice,
        views: &[View<'_>],
        encoder: &mut wgpu::CommandEncoder,
    ) -> (usize, &wgpu::Buffer) {
        let Self { shared, batch, placement, visibility, shading, .. } = self;
        shared.assets.evict_if_full(gpu);
        let n = batch.fill(views, self.limit, &mut shared.scenes, &mut shared.assets);
        let bytes = batch.size.bytes(self.samples_per_axis);
        let mut stale = shared.assets.upload(gpu);
        stale |= shared.scenes.upload(gpu);
        stale |= shared.views.write(gpu, &batch.views);
        stale |= shared.poses.write(gpu, &batch.poses);
        stale |= shared.instances.reserve(gpu, bytes.instances);
        stale |= match visibility {
            VisibilityPass::Raster(raster) => raster.reserve(gpu, batch, &bytes),
            VisibilityPass::Compute(compute) => compute.reserve(gpu, &bytes),
        };
        shading.prepare(gpu, bytes.images, &visibility.result(), shared, stale);
        match visibility {
            VisibilityPass::Raster(raster) => {
                raster.prepare(gpu, shared, stale);
                placement.prepare(gpu, shared, &[raster.draws()], stale);
                placement.encode(encoder, batch.views.len() as u32);
                raster.encode(encoder, batch, shared);
            }
            VisibilityPass::Compute(compute) => {
                compute.prepare(gpu, shared, stale);
                placement.prepare(gpu, shared, &compute.lists(), stale);
                compute.clear_lists(encoder);
                placement.encode(encoder, batch.views.len() as u32);
                compute.encode(encoder);
            }
        }
        shading.encode(encoder, batch.n_images, batch.max_side);
        (n, shading.images.buffer())
    }

    /// Returns the memory of all buffers and textures whose size depends on the chunk, in bytes.
    pub(crate) fn chunk_bytes(&self) -> u64 {
        let Self { shared, shading, .. } = self;
        let buffers = [&shared.views, &shared.poses, &shared.instances, &shading.images];
        let of_method = match &self.visibility {
            VisibilityPass::Raster(raster) => raster.n_bytes(),
            VisibilityPass::Compute(compute) => compute.n_bytes(),
        };
        buffers.map(|buffer| buffer.buffer().size()).iter().sum::<u64>() + of_method
    }
}

impl VisibilityPass {
    fn result(&self) -> VisibilityResult<'_> {
        match self {
            Self::Raster(raster) => VisibilityResult::Textures(raster.result()),
            Self::Compute(compute) => VisibilityResult::Buffers(compute.result()),
        }
    }
}
