//! Visibility pass on the hardware rasteriser: one layer of triangle ids per image, one layer of
//! heights per shadow map.

use super::batch::ViewBatch;
use super::bindings::{self, BindingKind};
use super::device::Gpu;
use super::draw_list::{DrawCall, DrawList};
use super::growable_buffer::GrowableBuffer;
use super::pipeline::SharedBuffers;
use super::records::NONE;
use super::texture_layers::TextureLayers;
use crate::render::shading::SHADOW_MAP_SIDE;

const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
const ID_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;

/// Pipelines and render targets of the pass.
pub(super) struct RasterVisibility {
    layout: wgpu::BindGroupLayout,
    id_pipeline: wgpu::RenderPipeline,
    height_pipeline: wgpu::RenderPipeline,
    ids: TextureLayers,
    depths: TextureLayers,
    heights: TextureLayers,
    /// Instance indices of the draw calls, for images and for shadow maps.
    instance_indices: [GrowableBuffer; 2],
    groups: Option<[wgpu::BindGroup; 2]>,
    samples_per_axis: u32,
}

impl RasterVisibility {
    /// Creates the pipelines for `samples_per_axis` samples per pixel along each axis.
    pub(super) fn new(gpu: &Gpu, samples_per_axis: u32) -> Self {
        // WGSL requires `enable` directives at the start of the source.
        let sources = [include_str!("wgsl/raster.wgsl"), include_str!("wgsl/records.wgsl")];
        let module = bindings::module(gpu, "raster", &sources);
        let layout = bindings::layout(gpu, wgpu::ShaderStages::VERTEX, &[BindingKind::ReadBuffer; 4]);
        let index_buffer = |label| GrowableBuffer::new(gpu, label, wgpu::BufferUsages::empty());
        Self {
            id_pipeline: pipeline(gpu, &layout, &module, &RasterTarget::IDS),
            height_pipeline: pipeline(gpu, &layout, &module, &RasterTarget::HEIGHTS),
            layout,
            ids: TextureLayers::new(gpu, ID_FORMAT),
            depths: TextureLayers::new(gpu, DEPTH_FORMAT),
            heights: TextureLayers::new(gpu, DEPTH_FORMAT),
            instance_indices: [index_buffer("image instances"), index_buffer("shadow map instances")],
            groups: None,
            samples_per_axis,
        }
    }

    /// Returns the inputs of the shading pass: ids of images and heights of shadow maps.
    pub(super) fn result(&self) -> [&wgpu::TextureView; 2] {
        [&self.ids.all, &self.heights.all]
    }

    /// Reserves space for a batch. Returns `true` if a texture was reallocated.
    pub(super) fn reserve(&mut self, gpu: &Gpu, batch: &ViewBatch) -> bool {
        let (side, n_maps) =
            (batch.max_side * self.samples_per_axis, batch.views.len() as u32 - batch.n_images);
        let mut reallocated = self.ids.reserve(gpu, side, batch.n_images);
        reallocated |= self.depths.reserve(gpu, side, batch.n_images);
        if n_maps > 0 {
            reallocated |= self.heights.reserve(gpu, SHADOW_MAP_SIDE, n_maps);
        }
        reallocated
    }

    /// Uploads the draw lists. `stale` is `true` if shared buffers were reallocated and bind groups must be
    /// recreated.
    pub(super) fn upload(
        &mut self,
        gpu: &Gpu,
        draw_lists: [&DrawList; 2],
        shared: &SharedBuffers,
        stale: bool,
    ) {
        let mut stale = stale || self.groups.is_none();
        for (buffer, draw_list) in self.instance_indices.iter_mut().zip(draw_lists) {
            stale |= buffer.write(gpu, &draw_list.instance_indices);
        }
        if stale {
            self.groups = Some(self.instance_indices.each_ref().map(|indices| {
                let buffers = [&shared.views, &shared.instances, &shared.assets.vertex_buffer, indices];
                bindings::group(gpu, &self.layout, &buffers.map(|buffer| buffer.buffer.as_entire_binding()))
            }));
        }
    }

    /// Encodes one render pass per image and per shadow map.
    pub(super) fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        batch: &ViewBatch,
        shared: &SharedBuffers,
    ) {
        let [image_group, map_group] = self.groups.as_ref().expect("upload() precedes encode()");
        let index_buffer = &shared.assets.index_buffer.buffer;
        for (i, calls) in batch.images.views().enumerate() {
            let mut pass = begin(encoder, Some(&self.ids.each[i]), &self.depths.each[i]);
            let side = (batch.views[i].side * self.samples_per_axis) as f32;
            pass.set_viewport(0.0, 0.0, side, side, 0.0, 1.0);
            pass.set_pipeline(&self.id_pipeline);
            pass.set_bind_group(0, image_group, &[]);
            draw(&mut pass, calls, index_buffer);
        }
        for (i, calls) in batch.shadow_maps.views().enumerate() {
            let mut pass = begin(encoder, None, &self.heights.each[i]);
            pass.set_pipeline(&self.height_pipeline);
            pass.set_bind_group(0, map_group, &[]);
            draw(&mut pass, calls, index_buffer);
        }
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
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    module: &wgpu::ShaderModule,
    target: &RasterTarget,
) -> wgpu::RenderPipeline {
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(target.vertex),
        layout: Some(&bindings::pipeline_layout(gpu, layout)),
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
            // Among equal depths the first one wins, which within a mesh is the one with the smallest id.
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

fn draw(pass: &mut wgpu::RenderPass<'_>, calls: &[DrawCall], index_buffer: &wgpu::Buffer) {
    pass.set_index_buffer(index_buffer.slice(..), wgpu::IndexFormat::Uint32);
    for DrawCall { mesh, instances } in calls {
        let first = mesh.first_triangle * 3;
        pass.draw_indexed(first..first + mesh.n_triangles * 3, 0, instances.clone());
    }
}
