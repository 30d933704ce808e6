//! Visibility by the rasteriser: ids of all images in one atlas, heights of all shadow maps in another.

use super::atlas::WIDTH;
use super::bindings::{self, Slot};
use super::device::Gpu;
use super::drawing::Drawing;
use super::frame::Shared;
use super::records::{NONE, ViewRecord};
use super::store::Store;

/// Rows by which an atlas grows.
const ROWS: u32 = 512;

const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
const ID_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;

/// Pipelines and atlases.
pub(super) struct Raster {
    layout: wgpu::BindGroupLayout,
    draw_ids: wgpu::RenderPipeline,
    draw_heights: wgpu::RenderPipeline,
    pub(super) ids: Texture,
    depths: Texture,
    pub(super) heights: Texture,
    /// Of images, and of maps: instances by mesh.
    drawn: [Store; 2],
    groups: Option<[wgpu::BindGroup; 2]>,
}

/// A texture as wide as an atlas.
pub(super) struct Texture {
    format: wgpu::TextureFormat,
    height: u32,
    pub(super) view: wgpu::TextureView,
}

impl Raster {
    /// Pipelines for `zoom` samples per pixel along each axis.
    pub(super) fn new(gpu: &Gpu, zoom: u32) -> Self {
        // `enable` comes before anything else.
        let module =
            bindings::module(gpu, "raster", &[include_str!("wgsl/raster.wgsl"), include_str!("wgsl/records.wgsl")]);
        let layout = bindings::layout(gpu, wgpu::ShaderStages::VERTEX, &[Slot::Read; 4]);
        let drawn = |label| Store::new(gpu, label, wgpu::BufferUsages::empty());
        Self {
            draw_ids: pipeline(gpu, &layout, &module, &Pass::IDS, zoom),
            draw_heights: pipeline(gpu, &layout, &module, &Pass::HEIGHTS, 1),
            layout,
            ids: Texture::new(gpu, ID_FORMAT, ROWS),
            depths: Texture::new(gpu, DEPTH_FORMAT, ROWS),
            heights: Texture::new(gpu, DEPTH_FORMAT, ROWS),
            drawn: [drawn("drawn in images"), drawn("drawn in maps")],
            groups: None,
        }
    }

    /// Makes room for atlases of these heights and tells the images and maps where they are; whether that took other
    /// textures.
    pub(super) fn fit(&mut self, gpu: &Gpu, heights: [u32; 2], [images, maps]: [&mut [ViewRecord]; 2]) -> bool {
        let [image_rows, map_rows] = heights;
        let mut grown = self.ids.fit(gpu, image_rows);
        grown |= self.depths.fit(gpu, image_rows);
        grown |= self.heights.fit(gpu, map_rows);
        for view in images {
            view.atlas_size = [WIDTH, self.ids.height];
        }
        for view in maps {
            view.atlas_size = [WIDTH, self.heights.height];
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

    /// Draws images, then maps if there are any.
    pub(super) fn encode(&self, encoder: &mut wgpu::CommandEncoder, [images, maps]: [&Drawing; 2], shared: &Shared) {
        let [image_group, map_group] = self.groups.as_ref().expect("uploaded before it is drawn");
        let ids = wgpu::RenderPassColorAttachment {
            view: &self.ids.view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color { r: f64::from(NONE), ..wgpu::Color::TRANSPARENT }),
                store: wgpu::StoreOp::Store,
            },
        };
        let mut pass = begin(encoder, &[Some(ids)], &self.depths, wgpu::StoreOp::Discard);
        draw(&mut pass, &self.draw_ids, image_group, images, shared);
        drop(pass);
        if !maps.draws.is_empty() {
            let mut pass = begin(encoder, &[], &self.heights, wgpu::StoreOp::Store);
            draw(&mut pass, &self.draw_heights, map_group, maps, shared);
        }
    }
}

impl Texture {
    fn new(gpu: &Gpu, format: wgpu::TextureFormat, height: u32) -> Self {
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: WIDTH, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        Self { format, height, view: texture.create_view(&wgpu::TextureViewDescriptor::default()) }
    }

    fn fit(&mut self, gpu: &Gpu, rows: u32) -> bool {
        if rows <= self.height {
            return false;
        }
        *self = Self::new(gpu, self.format, rows.next_multiple_of(ROWS));
        true
    }
}

/// What differs between images and maps.
struct Pass {
    vertex: &'static str,
    fragment: Option<&'static str>,
    cull: wgpu::Face,
}

impl Pass {
    const IDS: Self = Self { vertex: "camera_corner", fragment: Some("id"), cull: wgpu::Face::Back };
    const HEIGHTS: Self = Self { vertex: "map_corner", fragment: None, cull: wgpu::Face::Front };
}

fn pipeline(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    module: &wgpu::ShaderModule,
    pass: &Pass,
    zoom: u32,
) -> wgpu::RenderPipeline {
    let constants = [("ZOOM", f64::from(zoom))];
    let compilation_options =
        wgpu::PipelineCompilationOptions { constants: &constants, ..wgpu::PipelineCompilationOptions::default() };
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(pass.vertex),
        layout: Some(&bindings::pipeline_layout(gpu, layout)),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(pass.vertex),
            compilation_options: compilation_options.clone(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState {
            front_face: wgpu::FrontFace::Ccw,
            cull_mode: Some(pass.cull),
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
        fragment: pass.fragment.map(|entry_point| wgpu::FragmentState {
            module,
            entry_point: Some(entry_point),
            compilation_options,
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

/// A pass over an atlas whose depths are cleared to the farthest.
fn begin<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    color_attachments: &[Option<wgpu::RenderPassColorAttachment<'_>>],
    depths: &Texture,
    store: wgpu::StoreOp,
) -> wgpu::RenderPass<'a> {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: None,
        color_attachments,
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: &depths.view,
            depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store }),
            stencil_ops: None,
        }),
        ..wgpu::RenderPassDescriptor::default()
    })
}

fn draw(
    pass: &mut wgpu::RenderPass<'_>,
    pipeline: &wgpu::RenderPipeline,
    group: &wgpu::BindGroup,
    drawing: &Drawing,
    shared: &Shared,
) {
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, group, &[]);
    pass.set_index_buffer(shared.assets.index_store.buffer.slice(..), wgpu::IndexFormat::Uint32);
    for draw in &drawing.draws {
        let first = draw.place.first_triangle * 3;
        let indices = first..first + draw.place.n_triangles * 3;
        pass.draw_indexed(indices, 0, draw.first..draw.first + draw.n);
    }
}
