//! Selection of a renderer at start-up.

use thiserror::Error;

#[cfg(feature = "gpu")]
use super::gpu::{AdapterKind, GpuOptions, GpuRenderer};
use super::{CpuOptions, CpuRenderer, Renderer, RendererChoice, Samples};

/// Errors that can occur while opening a renderer.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the fields are named by their messages")]
pub enum OpenRendererError {
    #[error(
        "found no {wanted} that can render through Vulkan: {found}; use --renderer cpu or auto, or install a driver"
    )]
    NoAdapter { wanted: String, found: String },
    #[error("failed to open {name}: {message}")]
    Device { name: String, message: String },
    #[error(
        "this program was built without the GPU renderer; build it with `--features gpu`, or use --renderer cpu or auto"
    )]
    NotBuilt,
}

/// Opens a renderer for use in a rayon pool of `threads` threads. `gpu` is an index among the adapters of the
/// kind. `Auto` falls back to the CPU if no GPU can render and none was asked for by its index.
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
    threads: usize,
) -> Result<Box<dyn Renderer>, OpenRendererError> {
    let cpu =
        || Box::new(CpuRenderer::with_options(threads, CpuOptions { samples, ..CpuOptions::default() }));
    Ok(match choice {
        RendererChoice::Cpu => cpu(),
        RendererChoice::Auto if gpu.is_none() => open_gpu(choice, None, samples).unwrap_or_else(|_| cpu()),
        RendererChoice::Auto | RendererChoice::Gpu | RendererChoice::Software => {
            open_gpu(choice, gpu, samples)?
        }
    })
}

#[cfg(feature = "gpu")]
fn open_gpu(
    choice: RendererChoice,
    gpu: Option<u32>,
    samples: Samples,
) -> Result<Box<dyn Renderer>, OpenRendererError> {
    let kind = match choice {
        RendererChoice::Software => AdapterKind::Software,
        _ => AdapterKind::Hardware,
    };
    let index = gpu.map(|index| index as usize);
    Ok(Box::new(GpuRenderer::open(kind, &GpuOptions { samples, index, ..GpuOptions::default() })?))
}

#[cfg(not(feature = "gpu"))]
fn open_gpu(_: RendererChoice, _: Option<u32>, _: Samples) -> Result<Box<dyn Renderer>, OpenRendererError> {
    Err(OpenRendererError::NotBuilt)
}
