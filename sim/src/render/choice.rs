//! Which renderer draws.

use thiserror::Error;

use super::gpu::{AdapterKind, GpuOptions, GpuRenderer};
use super::{CpuOptions, CpuRenderer, Renderer, RendererChoice, Samples};

/// Why a renderer cannot be opened.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the fields are named by their messages")]
pub enum OpenError {
    #[error(
        "found no {wanted} that can draw through Vulkan: {found}; say --renderer cpu or auto, or install a driver"
    )]
    NoAdapter { wanted: &'static str, found: String },
    #[error("open {name}: {message}")]
    Device { name: String, message: String },
}

/// Opens a renderer for use in a rayon pool of this many threads.
///
/// # Errors
/// If a GPU or a software driver is asked for and none can draw.
///
/// # Panics
/// If `threads` is 0.
pub fn open(
    choice: RendererChoice,
    samples: Samples,
    threads: usize,
) -> Result<Box<dyn Renderer>, OpenError> {
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
