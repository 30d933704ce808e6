//! Kernels that share their buffers and run one after the other.

use gpu::{GpuDevice, GrowableBuffer, bind_group, compute_pipeline};

/// The kernels of a pass, with their buffers once those exist.
pub(crate) struct KernelPass {
    layout: wgpu::BindGroupLayout,
    kernels: Vec<wgpu::ComputePipeline>,
    group: Option<wgpu::BindGroup>,
}

impl KernelPass {
    /// Compiles the entry points of a WGSL source in several parts, for `samples_per_axis` samples per pixel
    /// along each axis. Their first `n_read` buffers are read-only, the next `n_written` are not.
    pub(crate) fn new(
        gpu: &GpuDevice,
        parts: &[&str],
        entry_points: &[&str],
        [n_read, n_written]: [u32; 2],
        samples_per_axis: u32,
    ) -> Self {
        let entries = (0..n_read + n_written).map(|binding| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only: binding < n_read },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        });
        let entries: Vec<_> = entries.collect();
        let descriptor = wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries };
        let layout = gpu.device.create_bind_group_layout(&descriptor);
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(entry_points[0]),
            source: wgpu::ShaderSource::Wgsl(parts.concat().into()),
        });
        let constants = [("SAMPLES_PER_AXIS", f64::from(samples_per_axis))];
        let kernels = entry_points
            .iter()
            .map(|entry| compute_pipeline(gpu, entry, Some(&layout), (&module, entry), &constants));
        Self { kernels: kernels.collect(), layout, group: None }
    }

    /// Binds the buffers, in the order of the bindings, if one of them was reallocated.
    pub(crate) fn bind(&mut self, gpu: &GpuDevice, buffers: &[&GrowableBuffer], reallocated: bool) {
        if reallocated || self.group.is_none() {
            let resources = buffers.iter().map(|buffer| buffer.buffer().as_entire_binding());
            self.group = Some(bind_group(gpu, &self.layout, resources));
        }
    }

    /// Encodes a dispatch of each kernel with so many workgroups.
    pub(crate) fn encode(&self, encoder: &mut wgpu::CommandEncoder, n_groups: &[[u32; 2]]) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_bind_group(0, self.group.as_ref().expect("bind() precedes encode()"), &[]);
        for (kernel, [x, y]) in self.kernels.iter().zip(n_groups) {
            pass.set_pipeline(kernel);
            pass.dispatch_workgroups(*x, *y, 1);
        }
    }
}
