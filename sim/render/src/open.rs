//! Selection of a renderer at start-up.

use ipc_types::ImageSizes;

#[cfg(feature = "gpu")]
use super::gpu::{AdapterKind, GpuRenderer};
use super::renderer::{OpenRendererError, Renderer};
use super::{CpuOptions, CpuRenderer, RendererChoice, Samples};

/// Opens a renderer of images no larger than `sizes` for use in a rayon pool of `threads` threads. `gpu` is
/// an index among the adapters of the kind. `Auto` falls back to the CPU if no GPU can render and none was
/// asked for by its index.
///
/// # Errors
/// If `choice` requires a GPU or a software driver and none can render, or if the feature `gpu` is off.
///
/// # Panics
/// If `threads` is 0.
pub fn open(
    choice: RendererChoice,
    gpu: Option<u32>,
    samples: Samples,
    sizes: ImageSizes,
    threads: usize,
) -> Result<Box<dyn Renderer>, OpenRendererError> {
    let cpu =
        || Box::new(CpuRenderer::with_options(threads, CpuOptions { samples, ..CpuOptions::default() }));
    Ok(match choice {
        RendererChoice::Cpu => cpu(),
        RendererChoice::Auto if gpu.is_none() => {
            open_gpu(choice, None, samples, sizes).unwrap_or_else(|_| cpu())
        }
        RendererChoice::Auto | RendererChoice::Gpu | RendererChoice::Software => {
            open_gpu(choice, gpu, samples, sizes)?
        }
    })
}

#[cfg(feature = "gpu")]
fn open_gpu(
    choice: RendererChoice,
    gpu: Option<u32>,
    samples: Samples,
    sizes: ImageSizes,
) -> Result<Box<dyn Renderer>, OpenRendererError> {
    let kind = match choice {
        RendererChoice::Software => AdapterKind::Software,
        _ => AdapterKind::Hardware,
    };
    let index = gpu.map(|index| index as usize);
    Ok(Box::new(GpuRenderer::open(kind, index, samples, sizes)?))
}

#[cfg(not(feature = "gpu"))]
fn open_gpu(
    _: RendererChoice,
    _: Option<u32>,
    _: Samples,
    _: ImageSizes,
) -> Result<Box<dyn Renderer>, OpenRendererError> {
    Err(OpenRendererError::NotBuilt)
}
