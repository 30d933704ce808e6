//! Bind group layouts, shader modules and compute pipelines. The layout and the bind group of a pass derive
//! from one ordered list of its resources.

use gpu::GpuDevice;

/// Kind of a bound resource.
#[derive(Clone, Copy)]
pub(crate) enum BindingKind {
    /// Read-only storage buffer.
    ReadBuffer,
    /// Read-write storage buffer.
    WriteBuffer,
    /// Array texture of triangle ids.
    IdTexture,
    /// Array texture of depths.
    DepthTexture,
}

/// Creates a bind group layout with the given resources at bindings 0, 1 and so on.
pub(crate) fn layout(
    gpu: &GpuDevice,
    visibility: wgpu::ShaderStages,
    kinds: &[BindingKind],
) -> wgpu::BindGroupLayout {
    let entries: Vec<_> = (0..)
        .zip(kinds)
        .map(|(binding, kind)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility,
            ty: kind.binding_type(),
            count: None,
        })
        .collect();
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries })
}

/// Creates a compute pipeline with a single bind group, for `samples_per_axis` samples per pixel along each
/// axis.
pub(crate) fn compute_pipeline(
    gpu: &GpuDevice,
    layout: &wgpu::BindGroupLayout,
    module: &wgpu::ShaderModule,
    entry_point: &str,
    samples_per_axis: u32,
) -> wgpu::ComputePipeline {
    let constants = [("SAMPLES_PER_AXIS", f64::from(samples_per_axis))];
    gpu::compute_pipeline(gpu, entry_point, Some(layout), (module, entry_point), &constants)
}

/// Compiles the concatenation of several WGSL sources.
pub(crate) fn module(gpu: &GpuDevice, label: &str, sources: &[&str]) -> wgpu::ShaderModule {
    gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(label),
        source: wgpu::ShaderSource::Wgsl(sources.concat().into()),
    })
}

impl BindingKind {
    fn binding_type(self) -> wgpu::BindingType {
        let buffer = |read_only| wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Storage { read_only },
            has_dynamic_offset: false,
            min_binding_size: None,
        };
        let texture = |sample_type| wgpu::BindingType::Texture {
            sample_type,
            view_dimension: wgpu::TextureViewDimension::D2Array,
            multisampled: false,
        };
        match self {
            Self::ReadBuffer => buffer(true),
            Self::WriteBuffer => buffer(false),
            Self::IdTexture => texture(wgpu::TextureSampleType::Uint),
            Self::DepthTexture => texture(wgpu::TextureSampleType::Depth),
        }
    }
}
