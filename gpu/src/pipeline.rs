//! Compute pipelines and bind groups.

use super::device::GpuDevice;

/// Creates a compute pipeline with a single bind group, whose layout derives from the kernel if there is
/// none. The kernel must write its workgroup memory before it reads it.
#[must_use]
pub fn compute_pipeline(
    gpu: &GpuDevice,
    label: &str,
    layout: Option<&wgpu::BindGroupLayout>,
    (module, entry_point): (&wgpu::ShaderModule, &str),
    constants: &[(&str, f64)],
) -> wgpu::ComputePipeline {
    let layout = layout.map(|layout| {
        gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(layout)],
            immediate_size: 0,
        })
    });
    gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(label),
        layout: layout.as_ref(),
        module,
        entry_point: Some(entry_point),
        compilation_options: wgpu::PipelineCompilationOptions {
            constants,
            zero_initialize_workgroup_memory: false,
        },
        cache: None,
    })
}

/// Creates a bind group with resources at bindings 0, 1 and so on.
pub fn bind_group<'r>(
    gpu: &GpuDevice,
    layout: &wgpu::BindGroupLayout,
    resources: impl IntoIterator<Item = wgpu::BindingResource<'r>>,
) -> wgpu::BindGroup {
    let entries: Vec<_> =
        (0..).zip(resources).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
}
