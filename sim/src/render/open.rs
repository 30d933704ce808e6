//! Selection of a renderer at start-up.

use thiserror::Error;

use super::gpu::{AdapterKind, GpuOptions, GpuRenderer};
use super::{CpuOptions, CpuRenderer, Renderer, RendererChoice, Samples};

/// Errors that can occur while opening a renderer.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the fields are named by their messages")]
pub enum OpenRendererError {
    #[error(
        "found no {wanted} that can render through Vulkan: {found}; use --renderer cpu or auto, or install a driver"
    )]
    NoAdapter { wanted: &'static str, found: String },
    #[error("failed to open {name}: {message}")]
    Device { name: String, message: String },
}

/// Opens a renderer for use in a rayon pool of `threads` threads. `Auto` falls back to the CPU if no GPU can
/// render.
///
/// # Errors
/// If `choice` requires a GPU or a software driver and none can render.
///
/// # Panics
/// If `threads` is 0.
pub fn open(
    choice: RendererChoice,
    samples: Samples,
    threads: usize,
) -> Result<Box<dyn Renderer>, OpenRendererError> {
    let gpu = |kind| GpuRenderer::open(kind, &GpuOptions { samples, ..GpuOptions::default() });
    let cpu = || CpuRenderer::with_options(threads, CpuOptions { samples, ..CpuOptions::default() });
    Ok(match choice {
        RendererChoice::Cpu => Box::new(cpu()),
        RendererChoice::Gpu => Box::new(gpu(AdapterKind::Hardware)?),
        RendererChoice::Software => Box::new(gpu(AdapterKind::Software)?),
        RendererChoice::Auto => match gpu(AdapterKind::Hardware) {
            Ok(renderer) => Box::new(renderer),
            Err(_) => Box::new(cpu()),
        },
    })
}
