//! The passes that render a chunk of views: placement, visibility and shading.

use gpu::{AdapterKind, GpuDevice};
use ipc_types::ImageSizes;

use super::buffers::ChunkBuffers;
use super::kernels::KernelPass;
use crate::View;
use crate::gpu::chunk::batch::ViewBatch;
use crate::gpu::chunk::size::{
    ChunkLimits, ChunkSize, LIST_ENTRY_BYTES, TILE, n_device_pixels, samples_per_axis,
};
use crate::gpu::resident::assets::Assets;
use crate::gpu::resident::scenes::ResidentScenes;
use crate::math::srgb::{LINEAR_SEGMENT_END, LINEAR_SEGMENT_SLOPE, SQRT_POLYNOMIAL};
use crate::renderer::OpenRendererError;
use crate::shading::{SHADOW_DEPTH_LEVELS, SHADOW_NORMAL_OFFSET_M, SPECULAR_FALLOFF, SPECULAR_VISIBILITY};
use run_config::Samples;

/// Number of workgroups along one axis that every device accepts.
const MAX_GROUPS: u64 = 65_535;
/// Largest number of large triangles for each workgroup on a software driver.
const SOFTWARE_TRIANGLES_PER_GROUP: u64 = 8;
/// Number of iterations after which Mesa's llvmpipe ends all loops of an invocation
/// (`LP_MAX_TGSI_LOOP_ITERATIONS`). What is left is not drawn.
const SOFTWARE_ITERATIONS: u64 = 65_535;
/// Number of samples for each thread of a workgroup and each iteration that a large triangle takes: one as
/// large as the image consists of six once it is clipped by five planes.
const SAMPLES_PER_ITERATION: u64 = 256 / 6;

const RECORDS: &str = include_str!("wgsl/records.wgsl");

/// All passes, with the chunk that is being prepared.
pub(crate) struct ImagePipeline {
    pub(crate) scenes: ResidentScenes,
    pub(crate) assets: Assets,
    pub(crate) limits: ChunkLimits,
    /// Limit for the chunks of the current batch.
    limit: ChunkSize,
    batch: ViewBatch,
    buffers: ChunkBuffers,
    samples_per_axis: u32,
    placement: KernelPass,
    /// Visibility in images: largest 1/z and its triangle id per sample.
    image_visibility: KernelPass,
    /// Visibility in shadow maps: the largest height per texel.
    map_visibility: KernelPass,
    shading: KernelPass,
    kind: AdapterKind,
}

impl ImagePipeline {
    /// Compiles the kernels and creates minimal buffers.
    ///
    /// # Errors
    /// If the device has no room for an env with images of these `sizes`.
    pub(crate) fn new(
        gpu: &GpuDevice,
        kind: AdapterKind,
        samples: Samples,
        sizes: ImageSizes,
    ) -> Result<Self, OpenRendererError> {
        let samples_per_axis = samples_per_axis(samples);
        let limits = ChunkLimits::new(gpu, kind, samples_per_axis, sizes)?;
        let visibility = |target, samples_per_axis| {
            let parts = [RECORDS, include_str!("wgsl/visibility.wgsl"), target];
            KernelPass::new(gpu, &parts, &["rasterise_small", "rasterise_large"], [5, 2], samples_per_axis)
        };
        let placement = [RECORDS, include_str!("wgsl/placement.wgsl")];
        let shading = [
            &constants(),
            RECORDS,
            include_str!("wgsl/intersection.wgsl"),
            include_str!("wgsl/texture.wgsl"),
            include_str!("wgsl/lighting.wgsl"),
            include_str!("wgsl/shading.wgsl"),
        ];
        Ok(Self {
            placement: KernelPass::new(gpu, &placement, &["place"], [3, 3], 1),
            image_visibility: visibility(include_str!("wgsl/camera_target.wgsl"), samples_per_axis),
            map_visibility: visibility(include_str!("wgsl/shadow_map_target.wgsl"), 1),
            shading: KernelPass::new(gpu, &shading, &["shade_tile"], [7, 1], samples_per_axis),
            scenes: ResidentScenes::new(gpu),
            assets: Assets::new(gpu),
            buffers: ChunkBuffers::new(gpu, &limits.bytes),
            limit: limits.largest,
            limits,
            batch: ViewBatch::new(samples_per_axis),
            samples_per_axis,
            kind,
        })
    }

    /// Begins a batch, which consists of several chunks.
    pub(crate) fn begin_batch(&mut self, views: &[View<'_>]) {
        if self.assets.has_many_meshes() {
            self.scenes.remove_dropped();
            self.assets.retain(&self.scenes.meshes());
        }
        self.limit = self.limits.for_batch(views.iter().map(n_device_pixels).sum());
    }

    /// Uploads the next chunk of `views` and encodes the commands that render it. Returns the number of its
    /// views, the buffer in which their images are stored consecutively, and their bytes.
    pub(crate) fn encode(
        &mut self,
        gpu: &GpuDevice,
        views: &[View<'_>],
        encoder: &mut wgpu::CommandEncoder,
    ) -> (usize, &wgpu::Buffer, u64) {
        let Self { scenes, assets, batch, buffers, .. } = self;
        assets.evict_if_full(gpu);
        let n = batch.fill(views, self.limit, scenes, assets);
        let bytes = batch.size.bytes(self.samples_per_axis);
        let mut reallocated = assets.upload(gpu);
        reallocated |= scenes.upload(gpu);
        reallocated |= buffers.reserve(gpu, &bytes);
        buffers.views.write_at(gpu, &batch.views, 0);
        buffers.poses.write_at(gpu, &batch.poses, 0);
        self.bind(gpu, reallocated);
        let Self { batch, buffers, .. } = &*self;
        // Remove all blocks.
        encoder.clear_buffer(buffers.image_blocks.buffer(), 0, Some(4));
        encoder.clear_buffer(buffers.map_blocks.buffer(), 0, Some(4));
        self.placement.encode(encoder, &[[batch.views.len() as u32, 1]]);
        for (pass, result, n_bytes, n_blocks) in [
            (&self.image_visibility, &buffers.samples, bytes.samples, batch.size.image_blocks),
            (&self.map_visibility, &buffers.heights, bytes.heights, batch.size.map_blocks),
        ] {
            if n_bytes > 0 {
                // Reset the count of large triangles.
                encoder.clear_buffer(buffers.large_triangles.buffer(), 0, Some(4));
                encoder.clear_buffer(result.buffer(), 0, Some(n_bytes));
                let n_large = bytes.large_triangles / LIST_ENTRY_BYTES;
                let n_samples = u64::from(batch.max_pixels * self.samples_per_axis.pow(2));
                pass.encode(encoder, &visibility_groups(self.kind, n_samples, n_blocks, n_large));
            }
        }
        self.shading.encode(encoder, &[[batch.max_pixels / TILE.pow(2), batch.n_images]]);
        (n, buffers.images.buffer(), bytes.images)
    }

    fn bind(&mut self, gpu: &GpuDevice, reallocated: bool) {
        let ChunkBuffers { views, poses, instances, image_blocks, map_blocks, .. } = &self.buffers;
        let ChunkBuffers { large_triangles, samples, heights, images, .. } = &self.buffers;
        let Assets { vertex_buffer, triangle_buffer, texel_buffer, .. } = &self.assets;
        let placed = [views, &self.scenes.buffer, poses, instances, image_blocks, map_blocks];
        self.placement.bind(gpu, &placed, reallocated);
        for (pass, blocks, result) in [
            (&mut self.image_visibility, image_blocks, samples),
            (&mut self.map_visibility, map_blocks, heights),
        ] {
            let buffers = [views, instances, vertex_buffer, triangle_buffer, blocks, large_triangles, result];
            pass.bind(gpu, &buffers, reallocated);
        }
        let shaded =
            [views, instances, vertex_buffer, triangle_buffer, texel_buffer, samples, heights, images];
        self.shading.bind(gpu, &shaded, reallocated);
    }

    /// Returns the memory of all buffers whose size depends on the chunk, in bytes.
    pub(crate) fn chunk_bytes(&self) -> u64 {
        self.buffers.n_bytes()
    }
}

/// Returns the workgroups that share up to `n_blocks` blocks, and those that share up to `n_large` large
/// triangles of images with up to `n_samples`.
fn visibility_groups(kind: AdapterKind, n_samples: u64, n_blocks: u64, n_large: u64) -> [[u32; 2]; 2] {
    let n_groups = match kind {
        AdapterKind::Hardware => [8192, 2048],
        AdapterKind::Software => {
            let most = SOFTWARE_ITERATIONS * SAMPLES_PER_ITERATION / n_samples;
            [n_blocks, n_large / most.clamp(1, SOFTWARE_TRIANGLES_PER_GROUP)]
        }
    };
    n_groups.map(|n| [n.min(MAX_GROUPS) as u32, 1])
}

/// Formats the constants of `render/shading.rs` and `math/srgb.rs` as WGSL. `{:?}` prints floats so that they
/// parse back exactly.
fn constants() -> String {
    let coefficients = SQRT_POLYNOMIAL.map(|c| format!("{c:?}")).join(", ");
    format!(
        "const SPECULAR_FALLOFF: f32 = {SPECULAR_FALLOFF:?};\n\
         const SPECULAR_VISIBILITY: f32 = {SPECULAR_VISIBILITY:?};\n\
         const SHADOW_NORMAL_OFFSET_M: f32 = {SHADOW_NORMAL_OFFSET_M:?};\n\
         const SHADOW_DEPTH_LEVELS: f32 = {SHADOW_DEPTH_LEVELS:?};\n\
         const LINEAR_SEGMENT_END: f32 = {LINEAR_SEGMENT_END:?};\n\
         const LINEAR_SEGMENT_SLOPE: f32 = {LINEAR_SEGMENT_SLOPE:?};\n\
         const SQRT_POLYNOMIAL = array<f32, 7>({coefficients});\n"
    )
}
