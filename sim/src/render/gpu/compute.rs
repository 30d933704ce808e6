//! Visibility pass on compute kernels: finds the largest 1/z and its triangle id per image sample, and
//! the largest height per shadow map texel.

use super::adapter::AdapterKind;
use super::batch::ViewBatch;
use super::bindings::{self, BindingKind};
use super::device::Gpu;
use super::draw_list::DrawList;
use super::growable_buffer::GrowableBuffer;
use super::pipeline::SharedBuffers;
use super::records::NONE;

/// Capacity of the list of large triangles, which whole workgroups rasterise. Triangles beyond it are
/// rasterised by single threads.
const MAX_LARGE: u64 = 1 << 16;
/// Workgroups along the first axis of a dispatch, within the limit that every device guarantees.
const MAX_GROUPS_X: usize = 32_768;

/// Kernels and buffers of the pass.
pub(super) struct ComputeVisibility {
    images: ComputeTarget,
    maps: ComputeTarget,
    /// Count and list of large triangles.
    large_triangles: GrowableBuffer,
    /// Workgroups that share the large triangles.
    n_groups: u32,
    samples_per_axis: u32,
}

/// Pipelines and buffers for one kind of view: images or shadow maps.
pub(super) struct ComputeTarget {
    layout: wgpu::BindGroupLayout,
    rasterise_small: wgpu::ComputePipeline,
    rasterise_large: wgpu::ComputePipeline,
    blocks: GrowableBuffer,
    padded_blocks: Vec<[u32; 2]>,
    /// Result per sample or texel.
    pub(super) visibility: GrowableBuffer,
    /// Bytes of `visibility` in use.
    n_bytes: u64,
    group: Option<wgpu::BindGroup>,
}

impl ComputeVisibility {
    /// Creates the kernels for `samples_per_axis` samples per pixel along each axis.
    pub(super) fn new(gpu: &Gpu, samples_per_axis: u32, kind: AdapterKind) -> Self {
        let large = GrowableBuffer::new(gpu, "large triangles", wgpu::BufferUsages::empty());
        let mut this = Self {
            images: ComputeTarget::new(gpu, include_str!("wgsl/camera_target.wgsl"), samples_per_axis),
            maps: ComputeTarget::new(gpu, include_str!("wgsl/shadow_map_target.wgsl"), 1),
            large_triangles: large,
            n_groups: match kind {
                AdapterKind::Hardware => 2048,
                AdapterKind::Software => 32,
            },
            samples_per_axis,
        };
        this.large_triangles.reserve(gpu, MAX_LARGE * 8);
        this
    }

    /// Returns the inputs of the shading pass: samples of images and texels of shadow maps.
    pub(super) fn result(&self) -> [&GrowableBuffer; 2] {
        [&self.images.visibility, &self.maps.visibility]
    }

    /// Reserves space for a batch. Returns `true` if a buffer was reallocated.
    pub(super) fn reserve(&mut self, gpu: &Gpu, batch: &ViewBatch) -> bool {
        let samples = u64::from(batch.n_pixels) * u64::from(self.samples_per_axis * self.samples_per_axis);
        (self.images.n_bytes, self.maps.n_bytes) = (samples * 8, u64::from(batch.n_shadow_pixels) * 4);
        let reallocated = self.images.visibility.reserve(gpu, self.images.n_bytes);
        self.maps.visibility.reserve(gpu, self.maps.n_bytes) || reallocated
    }

    /// Uploads the draw lists. `stale` is `true` if shared buffers were reallocated and bind groups must be
    /// recreated.
    pub(super) fn upload(
        &mut self,
        gpu: &Gpu,
        [images, maps]: [&DrawList; 2],
        shared: &SharedBuffers,
        stale: bool,
    ) {
        self.images.upload(gpu, images, shared, &self.large_triangles, stale);
        self.maps.upload(gpu, maps, shared, &self.large_triangles, stale);
    }

    /// Encodes the images, followed by the shadow maps if there are any.
    pub(super) fn encode(&self, encoder: &mut wgpu::CommandEncoder) {
        for target in [&self.images, &self.maps] {
            if target.n_bytes > 0 {
                // Reset the count of large triangles.
                encoder.clear_buffer(&self.large_triangles.buffer, 0, Some(4));
                target.encode(encoder, self.n_groups);
            }
        }
    }
}

impl ComputeTarget {
    fn new(gpu: &Gpu, target_source: &str, samples_per_axis: u32) -> Self {
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
        Self {
            rasterise_small: pipeline("rasterise_small"),
            rasterise_large: pipeline("rasterise_large"),
            blocks: GrowableBuffer::new(gpu, "blocks", wgpu::BufferUsages::empty()),
            padded_blocks: Vec::new(),
            visibility: GrowableBuffer::new(gpu, "visibility", wgpu::BufferUsages::empty()),
            n_bytes: 0,
            group: None,
            layout,
        }
    }

    fn upload(
        &mut self,
        gpu: &Gpu,
        draw_list: &DrawList,
        shared: &SharedBuffers,
        large: &GrowableBuffer,
        stale: bool,
    ) {
        // Pad to the size of the dispatch, so that every workgroup reads a valid entry.
        self.padded_blocks.clear();
        self.padded_blocks.extend_from_slice(&draw_list.blocks);
        let [columns, rows] = grid(draw_list.blocks.len());
        self.padded_blocks.resize((columns * rows) as usize, [NONE; 2]);
        let stale = self.blocks.write(gpu, &self.padded_blocks) || stale || self.group.is_none();
        if stale {
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
            let resources = buffers.map(|buffer| buffer.buffer.as_entire_binding());
            self.group = Some(bindings::group(gpu, &self.layout, &resources));
        }
    }

    fn encode(&self, encoder: &mut wgpu::CommandEncoder, n_groups: u32) {
        encoder.clear_buffer(&self.visibility.buffer, 0, Some(self.n_bytes));
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_bind_group(0, self.group.as_ref().expect("upload() precedes encode()"), &[]);
        let [columns, rows] = grid(self.padded_blocks.len());
        pass.set_pipeline(&self.rasterise_small);
        pass.dispatch_workgroups(columns, rows, 1);
        pass.set_pipeline(&self.rasterise_large);
        pass.dispatch_workgroups(n_groups, 1, 1);
    }
}

/// Returns the columns and rows of a dispatch of at least `n` workgroups.
fn grid(n: usize) -> [u32; 2] {
    [n.min(MAX_GROUPS_X) as u32, n.div_ceil(MAX_GROUPS_X) as u32]
}
