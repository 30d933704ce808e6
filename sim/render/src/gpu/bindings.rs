//! Bind groups, shader modules and compute pipelines. The layout and the bind group of a pass derive from one
//! ordered list of its resources.

use super::device::Gpu;

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
    gpu: &Gpu,
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

/// Creates a bind group with resources in the order of the layout.
pub(crate) fn group(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    resources: &[wgpu::BindingResource<'_>],
) -> wgpu::BindGroup {
    let entries: Vec<_> = (0..)
        .zip(resources)
        .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource: resource.clone() })
        .collect();
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
}

/// Creates the layout of a pipeline with a single bind group.
pub(crate) fn pipeline_layout(gpu: &Gpu, layout: &wgpu::BindGroupLayout) -> wgpu::PipelineLayout {
    gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    })
}

/// Creates a compute pipeline with a single bind group, for `samples_per_axis` samples per pixel along each
/// axis.
pub(crate) fn compute_pipeline(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    module: &wgpu::ShaderModule,
    entry_point: &str,
    samples_per_axis: u32,
) -> wgpu::ComputePipeline {
    gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry_point),
        layout: Some(&pipeline_layout(gpu, layout)),
        module,
        entry_point: Some(entry_point),
        compilation_options: wgpu::PipelineCompilationOptions {
            constants: &[("SAMPLES_PER_AXIS", f64::from(samples_per_axis))],
            zero_initialize_workgroup_memory: false,
        },
        cache: None,
    })
}

/// Compiles the concatenation of several WGSL sources.
pub(crate) fn module(gpu: &Gpu, label: &str, sources: &[&str]) -> wgpu::ShaderModule {
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
