//! Array textures with one layer per view.

use gpu::GpuDevice;

/// Granularity at which the number of layers grows.
pub(crate) const LAYER_STEP: u32 = 16;

/// A growable array texture with square layers. Every view starts at the top left pixel of its layer, so that
/// the rounding of the rasteriser does not depend on the layer.
pub(crate) struct TextureLayers {
    format: wgpu::TextureFormat,
    side: u32,
    /// View of all layers.
    pub(crate) all: wgpu::TextureView,
    /// One view per layer.
    pub(crate) each: Vec<wgpu::TextureView>,
}

impl TextureLayers {
    /// Creates a minimal texture.
    pub(crate) fn new(gpu: &GpuDevice, format: wgpu::TextureFormat) -> Self {
        Self::with(gpu, format, 8, 1)
    }

    /// Reserves space for `n` views of up to `side` × `side` px. Returns `true` if the texture was
    /// reallocated.
    pub(crate) fn reserve(&mut self, gpu: &GpuDevice, side: u32, n: u32) -> bool {
        let n_layers = self.each.len() as u32;
        if side <= self.side && n <= n_layers {
            return false;
        }
        let n_layers = if n <= n_layers { n_layers } else { n.next_multiple_of(LAYER_STEP) };
        *self = Self::with(gpu, self.format, side.max(self.side), n_layers);
        true
    }

    /// Returns the memory of all layers in bytes. A texel has four.
    pub(crate) fn n_bytes(&self) -> u64 {
        u64::from(self.side).pow(2) * self.each.len() as u64 * 4
    }

    fn with(gpu: &GpuDevice, format: wgpu::TextureFormat, side: u32, n: u32) -> Self {
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
