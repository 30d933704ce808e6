//! Visibility by the rasteriser: a layer of ids per image, a layer of heights per shadow map.

use super::batch::Batch;
use super::bindings::{self, Slot};
use super::device::Gpu;
use super::drawing::{Draw, Drawing};
use super::frame::Shared;
use super::layers::Layers;
use super::records::NONE;
use super::store::Store;
use crate::render::shading::SHADOW_MAP_SIDE;

const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
const ID_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;

/// Pipelines and layers.
pub(super) struct Raster {
    layout: wgpu::BindGroupLayout,
    draw_ids: wgpu::RenderPipeline,
    draw_heights: wgpu::RenderPipeline,
    ids: Layers,
    depths: Layers,
    heights: Layers,
    /// Of images, and of maps: instances by mesh.
    drawn: [Store; 2],
    groups: Option<[wgpu::BindGroup; 2]>,
    zoom: u32,
}

impl Raster {
    /// Pipelines for `zoom` samples per pixel along each axis.
    pub(super) fn new(gpu: &Gpu, zoom: u32) -> Self {
        // `enable` comes before anything else.
        let texts = [include_str!("wgsl/raster.wgsl"), include_str!("wgsl/records.wgsl")];
        let module = bindings::module(gpu, "raster", &texts);
        let layout = bindings::layout(gpu, wgpu::ShaderStages::VERTEX, &[Slot::Read; 4]);
        let drawn = |label| Store::new(gpu, label, wgpu::BufferUsages::empty());
        Self {
            draw_ids: pipeline(gpu, &layout, &module, &Kind::IDS),
            draw_heights: pipeline(gpu, &layout, &module, &Kind::HEIGHTS),
            layout,
            ids: Layers::new(gpu, ID_FORMAT),
            depths: Layers::new(gpu, DEPTH_FORMAT),
            heights: Layers::new(gpu, DEPTH_FORMAT),
            drawn: [drawn("drawn in images"), drawn("drawn in maps")],
            groups: None,
            zoom,
        }
    }

    /// What resolve reads: ids of images, heights of maps.
    pub(super) fn seen(&self) -> [&wgpu::TextureView; 2] {
        [&self.ids.all, &self.heights.all]
    }

    /// Makes room for a batch; whether that took other textures.
    pub(super) fn fit(&mut self, gpu: &Gpu, batch: &Batch) -> bool {
        let (side, n_maps) = (batch.max_side * self.zoom, batch.views.len() as u32 - batch.n_images);
        let mut grown = self.ids.fit(gpu, side, batch.n_images);
        grown |= self.depths.fit(gpu, side, batch.n_images);
        if n_maps > 0 {
            grown |= self.heights.fit(gpu, SHADOW_MAP_SIDE, n_maps);
        }
        grown
    }

    /// Brings what is to be drawn to the device; `stale` if other buffers are in use than before.
    pub(super) fn upload(&mut self, gpu: &Gpu, drawings: [&Drawing; 2], shared: &Shared, stale: bool) {
        let mut stale = stale || self.groups.is_none();
        for (store, drawing) in self.drawn.iter_mut().zip(drawings) {
            stale |= store.write(gpu, &drawing.drawn);
        }
        if stale {
            self.groups = Some(self.drawn.each_ref().map(|drawn| {
                let buffers = [&shared.views, &shared.instances, &shared.assets.vertex_store, drawn];
                bindings::group(gpu, &self.layout, &buffers.map(|store| store.buffer.as_entire_binding()))
            }));
        }
    }

    /// Draws images and maps, a pass for each.
    pub(super) fn encode(&self, encoder: &mut wgpu::CommandEncoder, batch: &Batch, shared: &Shared) {
        let [image_group, map_group] = self.groups.as_ref().expect("uploaded before it is drawn");
        let index_buffer = &shared.assets.index_store.buffer;
        for (i, draws) in batch.images.views().enumerate() {
            let mut pass = begin(encoder, Some(&self.ids.each[i]), &self.depths.each[i]);
            let side = (batch.views[i].side * self.zoom) as f32;
            pass.set_viewport(0.0, 0.0, side, side, 0.0, 1.0);
            pass.set_pipeline(&self.draw_ids);
            pass.set_bind_group(0, image_group, &[]);
            draw(&mut pass, draws, index_buffer);
        }
        for (i, draws) in batch.maps.views().enumerate() {
            let mut pass = begin(encoder, None, &self.heights.each[i]);
            pass.set_pipeline(&self.draw_heights);
            pass.set_bind_group(0, map_group, &[]);
            draw(&mut pass, draws, index_buffer);
        }
    }
}

/// What differs between images and maps.
struct Kind {
    vertex: &'static str,
    fragment: Option<&'static str>,
    cull: wgpu::Face,
}

impl Kind {
    const IDS: Self = Self { vertex: "camera_corner", fragment: Some("id"), cull: wgpu::Face::Back };
    const HEIGHTS: Self = Self { vertex: "map_corner", fragment: None, cull: wgpu::Face::Front };
}

fn pipeline(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    module: &wgpu::ShaderModule,
    kind: &Kind,
) -> wgpu::RenderPipeline {
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(kind.vertex),
        layout: Some(&bindings::pipeline_layout(gpu, layout)),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(kind.vertex),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState {
            front_face: wgpu::FrontFace::Ccw,
            cull_mode: Some(kind.cull),
            ..wgpu::PrimitiveState::default()
        },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(true),
            // The first of equals stays, which within a mesh is the one with the least id.
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: kind.fragment.map(|entry_point| wgpu::FragmentState {
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

/// A pass over a layer that is cleared to nothing, at the farthest; depths are kept where there are no ids.
fn begin<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    ids: Option<&wgpu::TextureView>,
    depths: &wgpu::TextureView,
) -> wgpu::RenderPass<'a> {
    let nothing = wgpu::Color { r: f64::from(NONE), ..wgpu::Color::TRANSPARENT };
    let color = ids.map(|view| wgpu::RenderPassColorAttachment {
        view,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations { load: wgpu::LoadOp::Clear(nothing), store: wgpu::StoreOp::Store },
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

fn draw(pass: &mut wgpu::RenderPass<'_>, draws: &[Draw], index_buffer: &wgpu::Buffer) {
    pass.set_index_buffer(index_buffer.slice(..), wgpu::IndexFormat::Uint32);
    for Draw { place, instances } in draws {
        let first = place.first_triangle * 3;
        pass.draw_indexed(first..first + place.n_triangles * 3, 0, instances.clone());
    }
}
