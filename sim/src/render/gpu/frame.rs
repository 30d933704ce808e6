//! Everything on the device that makes a chunk's images.

use super::adapter::AdapterKind;
use super::assets::Assets;
use super::batch::Batch;
use super::compute::Compute;
use super::device::Gpu;
use super::raster::Raster;
use super::resolve::{Resolve, Seen};
use super::store::Store;
use super::{GpuOptions, Visibility, samples_per_axis};
use crate::render::View;

/// What all passes read.
pub(super) struct Shared {
    pub(super) views: Store,
    pub(super) instances: Store,
    pub(super) assets: Assets,
}

/// Passes, their buffers, and the batch that is being put together.
pub(super) struct Frame {
    shared: Shared,
    batch: Batch,
    pass: Pass,
    resolve: Resolve,
}

/// How visibility is found.
enum Pass {
    Raster(Raster),
    Compute(Compute),
}

impl Frame {
    /// Pipelines and small buffers.
    pub(super) fn new(gpu: &Gpu, kind: AdapterKind, visibility: Visibility, options: &GpuOptions) -> Self {
        let zoom = samples_per_axis(options.samples);
        let pass = match visibility {
            Visibility::Raster => Pass::Raster(Raster::new(gpu, zoom)),
            Visibility::Compute => Pass::Compute(Compute::new(gpu, zoom, kind)),
        };
        let none = wgpu::BufferUsages::empty();
        let shared = Shared {
            views: Store::new(gpu, "views", none),
            instances: Store::new(gpu, "instances", none),
            assets: Assets::new(gpu),
        };
        Self { resolve: Resolve::new(gpu, &pass.seen(), zoom), shared, batch: Batch::new(), pass }
    }

    /// Brings views to the device and writes down the commands that make their images, one after the other in the
    /// buffer that is returned.
    pub(super) fn encode(
        &mut self,
        gpu: &Gpu,
        views: &[View<'_>],
        encoder: &mut wgpu::CommandEncoder,
    ) -> &wgpu::Buffer {
        let Self { shared, batch, pass, resolve } = self;
        shared.assets.trim();
        batch.fill(views, &mut shared.assets);
        let mut stale = shared.assets.upload(gpu);
        stale |= pass.fit(gpu, batch);
        stale |= shared.views.write(gpu, &batch.views);
        stale |= shared.instances.write(gpu, &batch.instances);
        resolve.fit(gpu, u64::from(batch.n_pixels) * 3, &pass.seen(), shared, stale);
        let drawings = [&batch.images, &batch.maps];
        match pass {
            Pass::Raster(raster) => {
                raster.upload(gpu, drawings, shared, stale);
                raster.encode(encoder, batch, shared);
            }
            Pass::Compute(compute) => {
                compute.upload(gpu, drawings, shared, stale);
                compute.encode(encoder);
            }
        }
        resolve.encode(encoder, batch.n_images, batch.max_side);
        &resolve.images.buffer
    }
}

impl Pass {
    fn seen(&self) -> Seen<'_> {
        match self {
            Self::Raster(raster) => Seen::Layers(raster.seen()),
            Self::Compute(compute) => Seen::Buffers(compute.seen()),
        }
    }

    /// Makes room for a batch; whether that took other resources.
    fn fit(&mut self, gpu: &Gpu, batch: &Batch) -> bool {
        match self {
            Self::Raster(raster) => raster.fit(gpu, batch),
            Self::Compute(compute) => compute.fit(gpu, batch),
        }
    }
}
