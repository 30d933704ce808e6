//! Compiled kernels and their dispatches.

use std::collections::HashMap;

use gpu::{DeviceBuffer, GpuDevice, bind_group, compute_pipeline};

/// Workgroups along one axis that every device accepts.
const MAX_GROUPS: usize = 65_535;

/// A WGSL source with the values of its overrides.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct KernelSource {
    pub(crate) name: &'static str,
    /// Concatenated in this order.
    pub(crate) parts: Vec<&'static str>,
    pub(crate) constants: Vec<(&'static str, u32)>,
}

/// Pipelines by source, so that layers of one shape share theirs.
#[derive(Debug, Default)]
pub struct KernelCache(HashMap<KernelSource, wgpu::ComputePipeline>);

/// A kernel with its buffers, ready to be encoded for a batch of any size.
#[derive(Debug)]
pub struct Dispatch {
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
    /// Work items along the first axis, per sample and per workgroup.
    pub(crate) items_per_sample: usize,
    pub(crate) items_per_group: usize,
    /// Workgroups along the other axes.
    pub(crate) groups_yz: [u32; 2],
}

impl KernelCache {
    /// Returns a dispatch of a kernel with `buffers` at bindings 0, 1 and so on. Its first axis has
    /// `items_per_sample` items for each sample, of which a workgroup takes `items_per_group`.
    pub(crate) fn dispatch(
        &mut self,
        gpu: &GpuDevice,
        source: KernelSource,
        buffers: &[&DeviceBuffer],
        (items_per_sample, items_per_group): (usize, usize),
        groups_yz: [u32; 2],
    ) -> Dispatch {
        let pipeline = self.0.entry(source).or_insert_with_key(|source| compile(gpu, source)).clone();
        let resources = buffers.iter().map(|buffer| buffer.0.as_entire_binding());
        let group = bind_group(gpu, &pipeline.get_bind_group_layout(0), resources);
        Dispatch { pipeline, group, items_per_sample, items_per_group, groups_yz }
    }
}

impl Dispatch {
    /// Returns the largest number of samples that one dispatch can take.
    #[must_use]
    pub fn max_samples(&self) -> usize {
        MAX_GROUPS * self.items_per_group / self.items_per_sample
    }

    pub(crate) fn encode(&self, pass: &mut wgpu::ComputePass<'_>, n_samples: usize) {
        let n_groups = (n_samples * self.items_per_sample).div_ceil(self.items_per_group);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.dispatch_workgroups(n_groups as u32, self.groups_yz[0], self.groups_yz[1]);
    }
}

fn compile(gpu: &GpuDevice, source: &KernelSource) -> wgpu::ComputePipeline {
    let descriptor = wgpu::ShaderModuleDescriptor {
        label: Some(source.name),
        source: wgpu::ShaderSource::Wgsl(source.parts.concat().into()),
    };
    // Counting the iterations of every loop and checking every index took a third of the time of
    // ACT on an H200.
    // SAFETY: every kernel is one of this crate. Its loops end at constants or at numbers that this crate has
    // uploaded, and its indices stay within its arrays and buffers for every thread and batch.
    let module = unsafe {
        gpu.device.create_shader_module_trusted(descriptor, wgpu::ShaderRuntimeChecks::unchecked())
    };
    let constants: Vec<(&str, f64)> =
        source.constants.iter().map(|(name, value)| (*name, f64::from(*value))).collect();
    compute_pipeline(gpu, source.name, None, (&module, "main"), &constants)
}
