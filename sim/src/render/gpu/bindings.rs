//! Bind groups: what a pass reads and writes, in one list from which layout and group are made.

use super::device::Gpu;

/// What a pass sees of a resource.
#[derive(Clone, Copy)]
pub(super) enum Slot {
    /// A storage buffer, read.
    Read,
    /// A storage buffer, read and written.
    Write,
    /// Layers of ids.
    Ids,
    /// Layers of depths.
    Depths,
}

/// A layout with these slots at bindings 0, 1 and so on.
pub(super) fn layout(gpu: &Gpu, visibility: wgpu::ShaderStages, slots: &[Slot]) -> wgpu::BindGroupLayout {
    let entries: Vec<_> = (0..)
        .zip(slots)
        .map(|(binding, slot)| wgpu::BindGroupLayoutEntry { binding, visibility, ty: slot.ty(), count: None })
        .collect();
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries })
}

/// Resources for the slots of a layout.
pub(super) fn group(
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

/// The layout of a pipeline with one group.
pub(super) fn pipeline_layout(gpu: &Gpu, layout: &wgpu::BindGroupLayout) -> wgpu::PipelineLayout {
    gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    })
}

/// A compute pipeline with one group, at `zoom` samples per pixel along each axis.
pub(super) fn compute_pipeline(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    module: &wgpu::ShaderModule,
    entry_point: &str,
    zoom: u32,
) -> wgpu::ComputePipeline {
    gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry_point),
        layout: Some(&pipeline_layout(gpu, layout)),
        module,
        entry_point: Some(entry_point),
        compilation_options: wgpu::PipelineCompilationOptions {
            constants: &[("ZOOM", f64::from(zoom))],
            zero_initialize_workgroup_memory: false,
        },
        cache: None,
    })
}

/// A shader out of several texts.
pub(super) fn module(gpu: &Gpu, label: &str, texts: &[&str]) -> wgpu::ShaderModule {
    gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(label),
        source: wgpu::ShaderSource::Wgsl(texts.concat().into()),
    })
}

impl Slot {
    fn ty(self) -> wgpu::BindingType {
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
            Self::Read => buffer(true),
            Self::Write => buffer(false),
            Self::Ids => texture(wgpu::TextureSampleType::Uint),
            Self::Depths => texture(wgpu::TextureSampleType::Depth),
        }
    }
}
