//! Deferred shading pass: turns the visibility result into packed sRGB bytes.

use gpu::{GpuDevice, GrowableBuffer, bind_group};

use super::bindings::{self, BindingKind};
use super::shared_buffers::SharedBuffers;
use crate::math::srgb::{LINEAR_SEGMENT_END, LINEAR_SEGMENT_SLOPE, SQRT_POLYNOMIAL};
use crate::shading::{SHADOW_DEPTH_LEVELS, SHADOW_NORMAL_OFFSET_M, SPECULAR_FALLOFF, SPECULAR_VISIBILITY};

/// Side of the pixel tile that a workgroup shades.
const TILE: u32 = 8;

/// Output of the visibility pass, as read by the shading kernel.
pub(crate) enum VisibilityResult<'a> {
    /// Array textures of ids and of shadow map heights.
    Textures([&'a wgpu::TextureView; 2]),
    /// Buffers of image samples and of shadow map heights.
    Buffers([&'a GrowableBuffer; 2]),
}

/// The shading kernel and its output.
pub(crate) struct ShadingPass {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
    /// sRGB bytes of all images, stored consecutively.
    pub(crate) images: GrowableBuffer,
    group: Option<wgpu::BindGroup>,
}

impl ShadingPass {
    /// Creates the kernel for `samples_per_axis` samples per pixel along each axis. The images of the largest
    /// chunk have `full_size` bytes.
    pub(crate) fn new(
        gpu: &GpuDevice,
        visibility: &VisibilityResult<'_>,
        samples_per_axis: u32,
        full_size: u64,
    ) -> Self {
        let (visibility_source, [ids, heights]) = match visibility {
            VisibilityResult::Textures(_) => (
                include_str!("wgsl/visibility_textures.wgsl"),
                [BindingKind::IdTexture, BindingKind::DepthTexture],
            ),
            VisibilityResult::Buffers(_) => {
                (include_str!("wgsl/visibility_buffers.wgsl"), [BindingKind::ReadBuffer; 2])
            }
        };
        let sources = [
            &constants(),
            include_str!("wgsl/records.wgsl"),
            visibility_source,
            include_str!("wgsl/intersection.wgsl"),
            include_str!("wgsl/texture.wgsl"),
            include_str!("wgsl/lighting.wgsl"),
            include_str!("wgsl/shading.wgsl"),
        ];
        let module = bindings::module(gpu, "shade_tile", &sources);
        let kinds = [
            BindingKind::ReadBuffer,
            BindingKind::ReadBuffer,
            BindingKind::ReadBuffer,
            BindingKind::ReadBuffer,
            BindingKind::ReadBuffer,
            BindingKind::WriteBuffer,
            ids,
            heights,
        ];
        let layout = bindings::layout(gpu, wgpu::ShaderStages::COMPUTE, &kinds);
        Self {
            pipeline: bindings::compute_pipeline(gpu, &layout, &module, "shade_tile", samples_per_axis),
            layout,
            images: GrowableBuffer::new(gpu, "images", wgpu::BufferUsages::empty(), full_size),
            group: None,
        }
    }

    /// Reserves `n_bytes` for images and recreates the bind group if necessary. `stale` is `true` if a
    /// resource of another pass was reallocated.
    pub(crate) fn prepare(
        &mut self,
        gpu: &GpuDevice,
        n_bytes: u64,
        visibility: &VisibilityResult<'_>,
        shared: &SharedBuffers,
        stale: bool,
    ) {
        let reallocated = self.images.reserve(gpu, n_bytes);
        if !(stale || reallocated || self.group.is_none()) {
            return;
        }
        let assets = &shared.assets;
        let buffers = [
            &shared.views,
            &shared.instances,
            &assets.vertex_buffer,
            &assets.triangle_buffer,
            &assets.texel_buffer,
            &self.images,
        ];
        let mut resources: Vec<_> = buffers.map(|buffer| buffer.buffer().as_entire_binding()).into();
        match visibility {
            VisibilityResult::Textures(views) => {
                resources.extend(views.map(wgpu::BindingResource::TextureView));
            }
            VisibilityResult::Buffers(buffers) => {
                resources.extend(buffers.map(|buffer| buffer.buffer().as_entire_binding()));
            }
        }
        self.group = Some(bind_group(gpu, &self.layout, resources));
    }

    /// Encodes the shading of `n_images` images, the largest of which has `max_side` × `max_side` px.
    pub(crate) fn encode(&self, encoder: &mut wgpu::CommandEncoder, n_images: u32, max_side: u32) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_bind_group(0, self.group.as_ref().expect("prepare() precedes encode()"), &[]);
        pass.set_pipeline(&self.pipeline);
        pass.dispatch_workgroups((max_side / TILE).pow(2), n_images, 1);
    }
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
