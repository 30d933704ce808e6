//! Textures with one layer per view.

use super::device::Gpu;

/// Layers by which a texture grows.
const STEP: u32 = 16;

/// Square layers; exchanged for more or larger ones when they are too few or too small. All views begin at the left upper
/// pixel of their layer, so that how a rasteriser rounds does not depend on which layer that is.
pub(super) struct Layers {
    format: wgpu::TextureFormat,
    side: u32,
    /// All of them.
    pub(super) all: wgpu::TextureView,
    /// Each of them.
    pub(super) each: Vec<wgpu::TextureView>,
}

impl Layers {
    /// Some small ones.
    pub(super) fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Self {
        Self::with(gpu, format, 8, 1)
    }

    /// Makes room for `n` views of up to `side` pixels; whether that took another texture.
    pub(super) fn fit(&mut self, gpu: &Gpu, side: u32, n: u32) -> bool {
        let n_layers = self.each.len() as u32;
        if side <= self.side && n <= n_layers {
            return false;
        }
        let n_layers = if n <= n_layers { n_layers } else { n.next_multiple_of(STEP) };
        *self = Self::with(gpu, self.format, side.max(self.side), n_layers);
        true
    }

    fn with(gpu: &Gpu, format: wgpu::TextureFormat, side: u32, n: u32) -> Self {
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: side, height: side, depth_or_array_layers: n },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        let view = |dimension, base_array_layer, n_layers| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(dimension),
                base_array_layer,
                array_layer_count: Some(n_layers),
                ..wgpu::TextureViewDescriptor::default()
            })
        };
        let each = (0..n).map(|layer| view(wgpu::TextureViewDimension::D2, layer, 1));
        Self { format, side, each: each.collect(), all: view(wgpu::TextureViewDimension::D2Array, 0, n) }
    }
}
