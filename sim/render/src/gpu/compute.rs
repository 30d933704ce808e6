//! Visibility pass on compute kernels: finds the largest 1/z and its triangle id per image sample, and
//! the largest height per shadow map texel.

use gpu::{AdapterKind, GpuDevice, GrowableBuffer, bind_group};

use super::bindings::{self, BindingKind};
use super::chunk::{ChunkBytes, ChunkLimits};
use super::shared_buffers::SharedBuffers;

/// Workgroups that share all blocks, and those that share all large triangles.
#[derive(Clone, Copy)]
struct GroupCounts {
    small: u32,
    large: u32,
}

/// Kernels and buffers of the pass.
pub(crate) struct ComputeVisibility {
    images: ComputeTarget,
    maps: ComputeTarget,
    /// Count and list of large triangles, which whole workgroups rasterise.
    large_triangles: GrowableBuffer,
    counts: GroupCounts,
}

/// Pipelines and buffers for one kind of view: images or shadow maps.
pub(crate) struct ComputeTarget {
    layout: wgpu::BindGroupLayout,
    rasterise_small: wgpu::ComputePipeline,
    rasterise_large: wgpu::ComputePipeline,
    /// Count and list of blocks of triangles, written by the placement pass.
    blocks: GrowableBuffer,
    /// Result per sample or texel.
    visibility: GrowableBuffer,
    /// Bytes of `visibility` in use.
    n_bytes: u64,
    group: Option<wgpu::BindGroup>,
}

impl ComputeVisibility {
    /// Creates the kernels for `samples_per_axis` samples per pixel along each axis.
    pub(crate) fn new(
        gpu: &GpuDevice,
        samples_per_axis: u32,
        kind: AdapterKind,
        limits: &ChunkLimits,
    ) -> Self {
        let ChunkBytes { blocks: [image_blocks, map_blocks], visibility: [samples, texels], .. } =
            limits.bytes;
        let image_source = include_str!("wgsl/camera_target.wgsl");
        let map_source = include_str!("wgsl/shadow_map_target.wgsl");
        Self {
            images: ComputeTarget::new(gpu, image_source, samples_per_axis, [image_blocks, samples]),
            maps: ComputeTarget::new(gpu, map_source, 1, [map_blocks, texels]),
            large_triangles: GrowableBuffer::new(
                gpu,
                "large triangles",
                wgpu::BufferUsages::empty(),
                limits.bytes.large_triangles,
            ),
            counts: match kind {
                AdapterKind::Hardware => GroupCounts { small: 8192, large: 2048 },
                AdapterKind::Software => GroupCounts { small: 64, large: 32 },
            },
        }
    }

    /// Returns the inputs of the shading pass: samples of images and texels of shadow maps.
    pub(crate) fn result(&self) -> [&GrowableBuffer; 2] {
        [&self.images.visibility, &self.maps.visibility]
    }

    /// Returns the outputs of the placement pass: blocks of images and of shadow maps.
    pub(crate) fn lists(&self) -> [&GrowableBuffer; 2] {
        [&self.images.blocks, &self.maps.blocks]
    }

    /// Reserves space for a chunk. Returns `true` if a buffer was reallocated.
    pub(crate) fn reserve(&mut self, gpu: &GpuDevice, bytes: &ChunkBytes) -> bool {
        let mut reallocated = self.large_triangles.reserve(gpu, bytes.large_triangles);
        for (i, target) in [&mut self.images, &mut self.maps].into_iter().enumerate() {
            target.n_bytes = bytes.visibility[i];
            reallocated |= target.blocks.reserve(gpu, bytes.blocks[i]);
            reallocated |= target.visibility.reserve(gpu, bytes.visibility[i]);
        }
        reallocated
    }

    /// Recreates the bind groups if a buffer was reallocated.
    pub(crate) fn prepare(&mut self, gpu: &GpuDevice, shared: &SharedBuffers, stale: bool) {
        self.images.prepare(gpu, shared, &self.large_triangles, stale);
        self.maps.prepare(gpu, shared, &self.large_triangles, stale);
    }

    /// Encodes the removal of all blocks, which precedes the placement pass.
    pub(crate) fn clear_lists(&self, encoder: &mut wgpu::CommandEncoder) {
        for target in [&self.images, &self.maps] {
            encoder.clear_buffer(target.blocks.buffer(), 0, Some(4));
        }
    }

    /// Encodes the images, followed by the shadow maps if there are any.
    pub(crate) fn encode(&self, encoder: &mut wgpu::CommandEncoder) {
        for target in [&self.images, &self.maps] {
            if target.n_bytes > 0 {
                // Reset the count of large triangles.
                encoder.clear_buffer(self.large_triangles.buffer(), 0, Some(4));
                target.encode(encoder, self.counts);
            }
        }
    }

    /// Returns the memory of all buffers in bytes.
    pub(crate) fn n_bytes(&self) -> u64 {
        let targets = [&self.images, &self.maps];
        let buffers = targets.into_iter().flat_map(|target| [&target.blocks, &target.visibility]);
        buffers.chain([&self.large_triangles]).map(|buffer| buffer.buffer().size()).sum()
    }
}

impl ComputeTarget {
    /// Creates the kernels. The sizes are those of `blocks` and `visibility` in the largest chunk.
    fn new(
        gpu: &GpuDevice,
        target_source: &str,
        samples_per_axis: u32,
        [blocks, visibility]: [u64; 2],
    ) -> Self {
        let sources = [include_str!("wgsl/records.wgsl"), include_str!("wgsl/compute.wgsl"), target_source];
        let module = bindings::module(gpu, "compute", &sources);
        let kinds = [
            BindingKind::ReadBuffer,
            BindingKind::ReadBuffer,
            BindingKind::ReadBuffer,
            BindingKind::ReadBuffer,
            BindingKind::ReadBuffer,
            BindingKind::WriteBuffer,
            BindingKind::WriteBuffer,
        ];
        let layout = bindings::layout(gpu, wgpu::ShaderStages::COMPUTE, &kinds);
        let pipeline = |entry| bindings::compute_pipeline(gpu, &layout, &module, entry, samples_per_axis);
        let buffer = |label, size| GrowableBuffer::new(gpu, label, wgpu::BufferUsages::empty(), size);
        Self {
            rasterise_small: pipeline("rasterise_small"),
            rasterise_large: pipeline("rasterise_large"),
            blocks: buffer("blocks", blocks),
            visibility: buffer("visibility", visibility),
            n_bytes: 0,
            group: None,
            layout,
        }
    }

    fn prepare(&mut self, gpu: &GpuDevice, shared: &SharedBuffers, large: &GrowableBuffer, stale: bool) {
        if stale || self.group.is_none() {
            let assets = &shared.assets;
            let buffers = [
                &shared.views,
                &shared.instances,
                &assets.vertex_buffer,
                &assets.triangle_buffer,
                &self.blocks,
                large,
                &self.visibility,
            ];
            let resources = buffers.map(|buffer| buffer.buffer().as_entire_binding());
            self.group = Some(bind_group(gpu, &self.layout, resources));
        }
    }

    fn encode(&self, encoder: &mut wgpu::CommandEncoder, counts: GroupCounts) {
        encoder.clear_buffer(self.visibility.buffer(), 0, Some(self.n_bytes));
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_bind_group(0, self.group.as_ref().expect("prepare() precedes encode()"), &[]);
        pass.set_pipeline(&self.rasterise_small);
        pass.dispatch_workgroups(counts.small, 1, 1);
        pass.set_pipeline(&self.rasterise_large);
        pass.dispatch_workgroups(counts.large, 1, 1);
    }
}
