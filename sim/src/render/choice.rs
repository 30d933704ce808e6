//! Which renderer draws.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::gpu::{AdapterKind, GpuOptions, GpuRenderer};
use super::{CpuOptions, CpuRenderer, Renderer, Samples};

/// What may be asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RendererChoice {
    /// A GPU if there is one that can draw, else the CPU.
    #[default]
    Auto,
    /// The CPU.
    Cpu,
    /// A GPU.
    Gpu,
    /// The GPU's renderer on a driver that runs on the CPU: for tests.
    Software,
}

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

impl RendererChoice {
    /// All, the default first.
    pub const ALL: [Self; 4] = [Self::Auto, Self::Cpu, Self::Gpu, Self::Software];

    /// Name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
            Self::Software => "software",
        }
    }
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
