//! Pictures on a GPU, through wgpu and Vulkan: a visibility pass finds the triangle of each pixel, a compute kernel shades
//! it, and the packed bytes are copied to where the policy will read them. The rules are those of `SHADING.md`.
//!
//! Views are made in chunks. While the device makes one, the CPU prepares the next. A picture depends on its view and the
//! device alone, not on the other views.

mod adapter;
mod assets;
mod batch;
mod bindings;
mod compute;
mod device;
mod drawing;
mod frame;
mod layers;
mod raster;
mod readback;
mod records;
mod resolve;
mod shadow;
mod store;

use core::ops::Range;
use core::pin::pin;
use core::task::{Context, Poll, Waker};
use std::time::Instant;

pub use adapter::AdapterKind;

use super::open::OpenRendererError;
use super::{RenderError, Renderer, Samples, View, name_with_samples};
use device::Gpu;
use frame::Frame;
use readback::Readback;

/// Pixels of a chunk: 32 envs with two external cameras and one hand camera. Mesa's lavapipe takes ten times as long per
/// env from 64 envs a dispatch on, and a GPU is busy with far fewer.
const CHUNK_PX: usize = 32 * (2 * 224 * 224 + 128 * 128);

/// Views of a chunk: as many layers of a texture as every device has.
const CHUNK_VIEWS: usize = 128;

/// How the triangle of each pixel is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visibility {
    /// By the rasteriser.
    Raster,
    /// By compute kernels with 64-bit atomics.
    Compute,
}

/// What may be chosen.
#[derive(Clone, Copy, Debug, Default)]
pub struct GpuOptions {
    /// How visibility is found; if `None`, as suits the adapter.
    pub visibility: Option<Visibility>,
    /// Anti-aliasing.
    pub samples: Samples,
}

/// Where the time of a call of [`Renderer::render`] went, in s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Timings {
    /// Preparing, uploading and submitting.
    pub submit_s: f64,
    /// Waiting for the device.
    pub wait_s: f64,
    /// Copying images to where they belong.
    pub readback_s: f64,
}

/// The renderer on a GPU.
pub struct GpuRenderer {
    frame: Frame,
    readbacks: [Readback; 2],
    timings: Timings,
    visibility: Visibility,
    samples: Samples,
    gpu: Gpu,
}

impl GpuRenderer {
    /// Opens the first adapter of a kind that can draw.
    ///
    /// # Errors
    /// If there is none, or it cannot be opened.
    pub fn open(kind: AdapterKind, options: &GpuOptions) -> Result<Self, OpenRendererError> {
        let found = adapter::find(kind, options)?;
        let visibility = found.visibility;
        let gpu = Gpu::open(found)?;
        let frame = Frame::new(&gpu, kind, visibility, options);
        // A driver that refuses a shader says so now.
        gpu.check().map_err(|error| OpenRendererError::Device {
            name: gpu.name.clone(),
            message: error.to_string(),
        })?;
        Ok(Self {
            frame,
            readbacks: Default::default(),
            timings: Timings::default(),
            visibility,
            samples: options.samples,
            gpu,
        })
    }

    /// Where the time of the last call went.
    #[must_use]
    pub fn timings(&self) -> Timings {
        self.timings
    }

    fn submit(&mut self, views: &[View<'_>], chunk_idx: usize) -> Result<(), RenderError> {
        let start = Instant::now();
        let descriptor = wgpu::CommandEncoderDescriptor::default();
        let mut encoder = self.gpu.device.create_command_encoder(&descriptor);
        let images = self.frame.encode(&self.gpu, views, &mut encoder);
        let n_bytes = views.iter().map(|view| view.out.len() as u64).sum();
        self.readbacks[chunk_idx % 2].submit(&self.gpu, encoder, images, n_bytes);
        self.timings.submit_s += start.elapsed().as_secs_f64();
        self.gpu.check()
    }

    fn collect(&mut self, views: &mut [View<'_>], chunk_idx: usize) -> Result<(), RenderError> {
        let readback = &mut self.readbacks[chunk_idx % 2];
        let start = Instant::now();
        readback.wait(&self.gpu)?;
        let finished = Instant::now();
        readback.collect(&self.gpu, views)?;
        self.timings.wait_s += (finished - start).as_secs_f64();
        self.timings.readback_s += finished.elapsed().as_secs_f64();
        Ok(())
    }
}

impl Renderer for GpuRenderer {
    fn name(&self) -> String {
        let visibility = match self.visibility {
            Visibility::Raster => "raster",
            Visibility::Compute => "compute",
        };
        name_with_samples(format!("gpu ({}, {visibility})", self.gpu.name), self.samples)
    }

    fn identity(&self) -> String {
        self.name()
    }

    fn render(&mut self, views: &mut [View<'_>]) -> Result<(), RenderError> {
        views.iter().for_each(View::check);
        self.timings = Timings::default();
        self.gpu.check()?;
        let (mut from, mut previous) = (0, None);
        for chunk_idx in 0.. {
            let chunk = chunk(views, from);
            if !chunk.is_empty() {
                self.submit(&views[chunk.clone()], chunk_idx)?;
            }
            if let Some(previous) = previous.replace(chunk.clone()) {
                self.collect(&mut views[previous], chunk_idx - 1)?;
            }
            if chunk.is_empty() {
                break;
            }
            from = chunk.end;
        }
        Ok(())
    }
}

/// Returns the number of samples per pixel along each axis.
const fn samples_per_axis(samples: Samples) -> u32 {
    match samples {
        Samples::One => 1,
        Samples::Four => 2,
    }
}

/// The views from `from` on that are made together: at least one if there are any.
fn chunk(views: &[View<'_>], from: usize) -> Range<usize> {
    let mut n_px = 0;
    let fits = |view: &&View<'_>| {
        n_px += view.out.len() / 3;
        n_px <= CHUNK_PX
    };
    let n = views[from..].iter().take(CHUNK_VIEWS).take_while(fits).count();
    from..(from + n.max(1)).min(views.len())
}

/// The result of a future that is ready at once, as all of wgpu's are where it is not in a browser.
fn ready<T>(future: impl Future<Output = T>) -> T {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(result) => result,
        Poll::Pending => unreachable!("wgpu answers at once"),
    }
}

#[cfg(test)]
mod tests;
