//! Placement pass: the instances of all views, and which of them each view may show.

use gpu::{GpuDevice, GrowableBuffer, bind_group};

use super::bindings::{self, BindingKind};
use super::options::VisibilityMethod;
use super::shared_buffers::SharedBuffers;

/// The kernel and its bind group.
pub(crate) struct PlacementPass {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
    group: Option<wgpu::BindGroup>,
}

impl PlacementPass {
    /// Creates the kernel that prepares a visibility method.
    pub(crate) fn new(gpu: &GpuDevice, visibility: VisibilityMethod) -> Self {
        let (output, n_outputs) = match visibility {
            VisibilityMethod::Raster => (include_str!("wgsl/placement_draws.wgsl"), 1),
            VisibilityMethod::Compute => (include_str!("wgsl/placement_blocks.wgsl"), 2),
        };
        let sources = [include_str!("wgsl/records.wgsl"), include_str!("wgsl/placement.wgsl"), output];
        let module = bindings::module(gpu, "place", &sources);
        let inputs = [BindingKind::ReadBuffer; 3];
        let kinds = inputs.into_iter().chain([BindingKind::WriteBuffer].repeat(1 + n_outputs));
        let layout = bindings::layout(gpu, wgpu::ShaderStages::COMPUTE, &kinds.collect::<Vec<_>>());
        Self { pipeline: bindings::compute_pipeline(gpu, &layout, &module, "place", 1), layout, group: None }
    }

    /// Recreates the bind group if a buffer was reallocated. `outputs` is what the visibility pass reads.
    pub(crate) fn prepare(
        &mut self,
        gpu: &GpuDevice,
        shared: &SharedBuffers,
        outputs: &[&GrowableBuffer],
        stale: bool,
    ) {
        if stale || self.group.is_none() {
            let inputs = [&shared.views, &shared.scenes.buffer, &shared.poses, &shared.instances];
            let buffers = inputs.into_iter().chain(outputs.iter().copied());
            let resources: Vec<_> = buffers.map(|buffer| buffer.buffer().as_entire_binding()).collect();
            self.group = Some(bind_group(gpu, &self.layout, resources));
        }
    }

    /// Encodes the placement of the instances of `n_views` views.
    pub(crate) fn encode(&self, encoder: &mut wgpu::CommandEncoder, n_views: u32) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_bind_group(0, self.group.as_ref().expect("prepare() precedes encode()"), &[]);
        pass.set_pipeline(&self.pipeline);
        pass.dispatch_workgroups(n_views, 1, 1);
    }
}
