//! Visibility by compute kernels: per image sample the greatest 1/z with its id, per map texel the greatest height.

use super::adapter::AdapterKind;
use super::batch::Batch;
use super::bindings::{self, Slot};
use super::device::Gpu;
use super::drawing::Drawing;
use super::frame::Shared;
use super::records::NONE;
use super::store::Store;

/// Triangles of one pass that may be left to whole workgroups; those beyond are filled by single threads.
const MAX_LARGE: u64 = 1 << 16;
/// Workgroups along the first axis of a dispatch: no more than every device has.
const ROW_OF_GROUPS: usize = 32_768;

/// Kernels and buffers.
pub(super) struct Compute {
    images: Target,
    maps: Target,
    /// Number and list of triangles left to workgroups.
    large: Store,
    /// Workgroups that share them.
    n_groups: u32,
    zoom: u32,
}

/// What one kind of view is drawn with and into.
pub(super) struct Target {
    layout: wgpu::BindGroupLayout,
    draw_small: wgpu::ComputePipeline,
    draw_large: wgpu::ComputePipeline,
    blocks: Store,
    padded_blocks: Vec<[u32; 2]>,
    /// What is seen.
    pub(super) seen: Store,
    /// Bytes of it that are in use.
    n_bytes: u64,
    group: Option<wgpu::BindGroup>,
}

impl Compute {
    /// Kernels for `zoom` samples per pixel along each axis.
    pub(super) fn new(gpu: &Gpu, zoom: u32, kind: AdapterKind) -> Self {
        let large = Store::new(gpu, "large", wgpu::BufferUsages::empty());
        let mut this = Self {
            images: Target::new(gpu, include_str!("wgsl/camera_target.wgsl"), zoom),
            maps: Target::new(gpu, include_str!("wgsl/map_target.wgsl"), 1),
            large,
            n_groups: match kind {
                AdapterKind::Hardware => 2048,
                AdapterKind::Software => 32,
            },
            zoom,
        };
        this.large.fit(gpu, MAX_LARGE * 8);
        this
    }

    /// What resolve reads: samples of images, texels of maps.
    pub(super) fn seen(&self) -> [&Store; 2] {
        [&self.images.seen, &self.maps.seen]
    }

    /// Makes room for a batch; whether that took other buffers.
    pub(super) fn fit(&mut self, gpu: &Gpu, batch: &Batch) -> bool {
        let samples = u64::from(batch.n_pixels) * u64::from(self.zoom * self.zoom);
        (self.images.n_bytes, self.maps.n_bytes) = (samples * 8, u64::from(batch.n_map_pixels) * 4);
        let grown = self.images.seen.fit(gpu, self.images.n_bytes);
        self.maps.seen.fit(gpu, self.maps.n_bytes) || grown
    }

    /// Brings what is to be drawn to the device; `stale` if other buffers are in use than before.
    pub(super) fn upload(&mut self, gpu: &Gpu, [images, maps]: [&Drawing; 2], shared: &Shared, stale: bool) {
        self.images.upload(gpu, images, shared, &self.large, stale);
        self.maps.upload(gpu, maps, shared, &self.large, stale);
    }

    /// Draws images, then maps if there are any.
    pub(super) fn encode(&self, encoder: &mut wgpu::CommandEncoder) {
        for target in [&self.images, &self.maps] {
            if target.n_bytes > 0 {
                // The number of large triangles.
                encoder.clear_buffer(&self.large.buffer, 0, Some(4));
                target.encode(encoder, self.n_groups);
            }
        }
    }
}

impl Target {
    fn new(gpu: &Gpu, target: &str, zoom: u32) -> Self {
        let texts = [include_str!("wgsl/records.wgsl"), include_str!("wgsl/compute.wgsl"), target];
        let module = bindings::module(gpu, "compute", &texts);
        let slots = [Slot::Read, Slot::Read, Slot::Read, Slot::Read, Slot::Read, Slot::Write, Slot::Write];
        let layout = bindings::layout(gpu, wgpu::ShaderStages::COMPUTE, &slots);
        let pipeline = |entry| bindings::compute_pipeline(gpu, &layout, &module, entry, zoom);
        Self {
            draw_small: pipeline("draw_small"),
            draw_large: pipeline("draw_large"),
            blocks: Store::new(gpu, "blocks", wgpu::BufferUsages::empty()),
            padded_blocks: Vec::new(),
            seen: Store::new(gpu, "seen", wgpu::BufferUsages::empty()),
            n_bytes: 0,
            group: None,
            layout,
        }
    }

    fn upload(&mut self, gpu: &Gpu, drawing: &Drawing, shared: &Shared, large: &Store, stale: bool) {
        // Every workgroup of the dispatch finds a block.
        self.padded_blocks.clear();
        self.padded_blocks.extend_from_slice(&drawing.blocks);
        let [columns, rows] = grid(drawing.blocks.len());
        self.padded_blocks.resize((columns * rows) as usize, [NONE; 2]);
        let stale = self.blocks.write(gpu, &self.padded_blocks) || stale || self.group.is_none();
        if stale {
            let assets = &shared.assets;
            let stores = [
                &shared.views,
                &shared.instances,
                &assets.vertex_store,
                &assets.triangle_store,
                &self.blocks,
                large,
                &self.seen,
            ];
            let resources = stores.map(|store| store.buffer.as_entire_binding());
            self.group = Some(bindings::group(gpu, &self.layout, &resources));
        }
    }

    fn encode(&self, encoder: &mut wgpu::CommandEncoder, n_groups: u32) {
        encoder.clear_buffer(&self.seen.buffer, 0, Some(self.n_bytes));
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_bind_group(0, self.group.as_ref().expect("uploaded before it is drawn"), &[]);
        let [columns, rows] = grid(self.padded_blocks.len());
        pass.set_pipeline(&self.draw_small);
        pass.dispatch_workgroups(columns, rows, 1);
        pass.set_pipeline(&self.draw_large);
        pass.dispatch_workgroups(n_groups, 1, 1);
    }
}

/// Columns and rows of workgroups of which there are at least `n`.
fn grid(n: usize) -> [u32; 2] {
    [n.min(ROW_OF_GROUPS) as u32, n.div_ceil(ROW_OF_GROUPS) as u32]
}
