//! Visibility pass on the hardware rasteriser: one layer of triangle ids per image, one layer of
//! heights per shadow map.

use gpu::{GpuDevice, GrowableBuffer, bind_group};

use super::batch::ViewBatch;
use super::bindings::{self, BindingKind};
use super::chunk::{ChunkBytes, ChunkLimits, DRAW_BYTES};
use super::records::{NONE, ViewRecord};
use super::shared_buffers::SharedBuffers;
use super::texture_layers::TextureLayers;
use crate::shading::SHADOW_MAP_SIDE;

const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
const ID_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;

/// Pipelines and render targets of the pass.
pub(crate) struct RasterVisibility {
    layout: wgpu::BindGroupLayout,
    id_pipeline: wgpu::RenderPipeline,
    height_pipeline: wgpu::RenderPipeline,
    ids: TextureLayers,
    depths: TextureLayers,
    heights: TextureLayers,
    /// One draw call per instance, written by the placement pass.
    draws: GrowableBuffer,
    group: Option<wgpu::BindGroup>,
    samples_per_axis: u32,
}

impl RasterVisibility {
    /// Creates the pipelines for `samples_per_axis` samples per pixel along each axis.
    pub(crate) fn new(gpu: &GpuDevice, samples_per_axis: u32, limits: &ChunkLimits) -> Self {
        // WGSL requires `enable` directives at the start of the source.
        let sources = [include_str!("wgsl/raster.wgsl"), include_str!("wgsl/records.wgsl")];
        let module = bindings::module(gpu, "raster", &sources);
        let layout = bindings::layout(gpu, wgpu::ShaderStages::VERTEX, &[BindingKind::ReadBuffer; 3]);
        Self {
            id_pipeline: pipeline(gpu, &layout, &module, &RasterTarget::IDS),
            height_pipeline: pipeline(gpu, &layout, &module, &RasterTarget::HEIGHTS),
            layout,
            ids: TextureLayers::new(gpu, ID_FORMAT),
            depths: TextureLayers::new(gpu, DEPTH_FORMAT),
            heights: TextureLayers::new(gpu, DEPTH_FORMAT),
            draws: GrowableBuffer::new(gpu, "draws", wgpu::BufferUsages::INDIRECT, limits.bytes.draws),
            group: None,
            samples_per_axis,
        }
    }

    /// Returns the inputs of the shading pass: ids of images and heights of shadow maps.
    pub(crate) fn result(&self) -> [&wgpu::TextureView; 2] {
        [&self.ids.all, &self.heights.all]
    }

    /// Returns the output of the placement pass.
    pub(crate) fn draws(&self) -> &GrowableBuffer {
        &self.draws
    }

    /// Reserves space for a chunk. Returns `true` if a texture or buffer was reallocated.
    pub(crate) fn reserve(&mut self, gpu: &GpuDevice, batch: &ViewBatch, bytes: &ChunkBytes) -> bool {
        let (side, n_maps) =
            (batch.max_side * self.samples_per_axis, batch.views.len() as u32 - batch.n_images);
        let mut reallocated = self.ids.reserve(gpu, side, batch.n_images);
        reallocated |= self.depths.reserve(gpu, side, batch.n_images);
        if n_maps > 0 {
            reallocated |= self.heights.reserve(gpu, SHADOW_MAP_SIDE, n_maps);
        }
        self.draws.reserve(gpu, bytes.draws) || reallocated
    }

    /// Recreates the bind group if a buffer was reallocated.
    pub(crate) fn prepare(&mut self, gpu: &GpuDevice, shared: &SharedBuffers, stale: bool) {
        if stale || self.group.is_none() {
            let buffers = [&shared.views, &shared.instances, &shared.assets.vertex_buffer];
            let resources = buffers.map(|buffer| buffer.buffer().as_entire_binding());
            self.group = Some(bind_group(gpu, &self.layout, resources));
        }
    }

    /// Encodes one render pass per image and per shadow map.
    pub(crate) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        batch: &ViewBatch,
        shared: &SharedBuffers,
    ) {
        for view in &batch.views {
            let layer = view.layer as usize;
            let mut pass = if view.is_shadow_map == 0 {
                let mut pass = begin(encoder, Some(&self.ids.each[layer]), &self.depths.each[layer]);
                let side = (view.side * self.samples_per_axis) as f32;
                pass.set_viewport(0.0, 0.0, side, side, 0.0, 1.0);
                pass.set_pipeline(&self.id_pipeline);
                pass
            } else {
                let mut pass = begin(encoder, None, &self.heights.each[layer]);
                pass.set_pipeline(&self.height_pipeline);
                pass
            };
            pass.set_bind_group(0, self.group.as_ref().expect("prepare() precedes encode()"), &[]);
            pass.set_index_buffer(shared.assets.index_buffer.buffer().slice(..), wgpu::IndexFormat::Uint32);
            let ViewRecord { first_instance, n_instances, .. } = *view;
            let offset = u64::from(first_instance) * DRAW_BYTES;
            pass.multi_draw_indexed_indirect(self.draws.buffer(), offset, n_instances);
        }
    }

    /// Returns the memory of all buffers and textures in bytes.
    pub(crate) fn n_bytes(&self) -> u64 {
        self.ids.n_bytes() + self.depths.n_bytes() + self.heights.n_bytes() + self.draws.buffer().size()
    }
}

/// Differences between the pipelines for images and for shadow maps.
struct RasterTarget {
    vertex: &'static str,
    fragment: Option<&'static str>,
    cull: wgpu::Face,
}

impl RasterTarget {
    const IDS: Self = Self { vertex: "camera_vertex", fragment: Some("triangle_id"), cull: wgpu::Face::Back };
    const HEIGHTS: Self = Self { vertex: "shadow_map_vertex", fragment: None, cull: wgpu::Face::Front };
}

fn pipeline(
    gpu: &GpuDevice,
    layout: &wgpu::BindGroupLayout,
    module: &wgpu::ShaderModule,
    target: &RasterTarget,
) -> wgpu::RenderPipeline {
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(target.vertex),
        layout: Some(&gpu::pipeline_layout(gpu, layout)),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(target.vertex),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState {
            front_face: wgpu::FrontFace::Ccw,
            cull_mode: Some(target.cull),
            ..wgpu::PrimitiveState::default()
        },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(true),
            // Among equal depths the first one wins, which is the one with the smallest id.
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: target.fragment.map(|entry_point| wgpu::FragmentState {
            module,
            entry_point: Some(entry_point),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(wgpu::ColorTargetState {
                format: ID_FORMAT,
                blend: None,
                write_mask: wgpu::ColorWrites::ALL,
            })],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// Begins a render pass on a layer cleared to [`NONE`] at infinite distance. Depths are stored only if there
/// are no ids.
fn begin<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    ids: Option<&wgpu::TextureView>,
    depths: &wgpu::TextureView,
) -> wgpu::RenderPass<'a> {
    let background = wgpu::Color { r: f64::from(NONE), ..wgpu::Color::TRANSPARENT };
    let color = ids.map(|view| wgpu::RenderPassColorAttachment {
        view,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations { load: wgpu::LoadOp::Clear(background), store: wgpu::StoreOp::Store },
    });
    let store = if ids.is_some() { wgpu::StoreOp::Discard } else { wgpu::StoreOp::Store };
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: None,
        color_attachments: if color.is_some() { core::slice::from_ref(&color) } else { &[] },
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: depths,
            depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store }),
            stencil_ops: None,
        }),
        ..wgpu::RenderPassDescriptor::default()
    })
}
