//! From what is seen to bytes.

use super::bindings::{self, Slot};
use super::device::Gpu;
use super::frame::Shared;
use super::store::Store;
use crate::render::math::srgb::{LINEAR_SEGMENT_END, LINEAR_SEGMENT_SLOPE, SQRT_POLYNOMIAL};
use crate::render::shading::{
    GROUND_AMBIENT, SHADOW_DEPTH_LEVELS, SHADOW_NORMAL_OFFSET_M, SPECULAR_FALLOFF, SPECULAR_GAIN,
};

/// Pixels along each edge of the square that a workgroup makes.
const TILE: u32 = 8;

/// What the kernel reads of the visibility pass.
pub(super) enum Seen<'a> {
    /// Layers of ids and of heights.
    Layers([&'a wgpu::TextureView; 2]),
    /// Buffers of samples and of heights.
    Buffers([&'a Store; 2]),
}

/// The kernel and the images it makes.
pub(super) struct Resolve {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
    /// Bytes of all images, one after the other.
    pub(super) images: Store,
    group: Option<wgpu::BindGroup>,
}

impl Resolve {
    /// The kernel for `zoom` samples per pixel along each axis.
    pub(super) fn new(gpu: &Gpu, seen: &Seen<'_>, zoom: u32) -> Self {
        let (text, slot) = match seen {
            Seen::Layers(_) => (include_str!("wgsl/seen_in_layers.wgsl"), [Slot::Ids, Slot::Depths]),
            Seen::Buffers(_) => (include_str!("wgsl/seen_in_buffers.wgsl"), [Slot::Read; 2]),
        };
        let texts = [
            &constants(),
            include_str!("wgsl/records.wgsl"),
            text,
            include_str!("wgsl/triangle.wgsl"),
            include_str!("wgsl/texture.wgsl"),
            include_str!("wgsl/light.wgsl"),
            include_str!("wgsl/resolve.wgsl"),
        ];
        let module = bindings::module(gpu, "resolve", &texts);
        let [ids, heights] = slot;
        let slots = [Slot::Read, Slot::Read, Slot::Read, Slot::Read, Slot::Read, Slot::Write, ids, heights];
        let layout = bindings::layout(gpu, wgpu::ShaderStages::COMPUTE, &slots);
        Self {
            pipeline: bindings::compute_pipeline(gpu, &layout, &module, "resolve", zoom),
            layout,
            images: Store::new(gpu, "images", wgpu::BufferUsages::COPY_SRC),
            group: None,
        }
    }

    /// Makes room for images of so many bytes; `stale` if other resources are in use than before.
    pub(super) fn fit(&mut self, gpu: &Gpu, n_bytes: u64, seen: &Seen<'_>, shared: &Shared, stale: bool) {
        let grown = self.images.fit(gpu, n_bytes);
        if !(stale || grown || self.group.is_none()) {
            return;
        }
        let assets = &shared.assets;
        let stores = [
            &shared.views,
            &shared.instances,
            &assets.vertex_store,
            &assets.triangle_store,
            &assets.texel_store,
            &self.images,
        ];
        let mut resources: Vec<_> = stores.map(|store| store.buffer.as_entire_binding()).into();
        match seen {
            Seen::Layers(views) => resources.extend(views.map(wgpu::BindingResource::TextureView)),
            Seen::Buffers(stores) => resources.extend(stores.map(|store| store.buffer.as_entire_binding())),
        }
        self.group = Some(bindings::group(gpu, &self.layout, &resources));
    }

    /// Makes `n_images` images, the largest with this side.
    pub(super) fn encode(&self, encoder: &mut wgpu::CommandEncoder, n_images: u32, max_side: u32) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_bind_group(0, self.group.as_ref().expect("room was made before"), &[]);
        pass.set_pipeline(&self.pipeline);
        pass.dispatch_workgroups((max_side / TILE).pow(2), n_images, 1);
    }
}

/// Numbers of `shading.rs` and `math/srgb.rs` in WGSL; `{:?}` writes every bit of one.
fn constants() -> String {
    let coefficients = SQRT_POLYNOMIAL.map(|c| format!("{c:?}")).join(", ");
    format!(
        "const SPECULAR_GAIN: f32 = {SPECULAR_GAIN:?};\n\
         const SPECULAR_FALLOFF: f32 = {SPECULAR_FALLOFF:?};\n\
         const GROUND_AMBIENT: f32 = {GROUND_AMBIENT:?};\n\
         const SHADOW_NORMAL_OFFSET_M: f32 = {SHADOW_NORMAL_OFFSET_M:?};\n\
         const SHADOW_DEPTH_LEVELS: f32 = {SHADOW_DEPTH_LEVELS:?};\n\
         const LINEAR_SEGMENT_END: f32 = {LINEAR_SEGMENT_END:?};\n\
         const LINEAR_SEGMENT_SLOPE: f32 = {LINEAR_SEGMENT_SLOPE:?};\n\
         const SQRT_POLYNOMIAL = array<f32, 7>({coefficients});\n"
    )
}
