//! Options of the GPU renderer.

use crate::Samples;

/// Method of finding the visible triangle of each pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VisibilityMethod {
    /// The hardware rasteriser.
    Raster,
    /// Compute kernels with 64-bit atomics.
    Compute,
}

/// Options of the GPU renderer.
#[derive(Clone, Copy, Debug, Default)]
pub struct GpuOptions {
    /// Visibility method; `None` selects the one that suits the adapter.
    pub visibility: Option<VisibilityMethod>,
    /// Samples per pixel, for anti-aliasing.
    pub samples: Samples,
    /// Index among the adapters of the kind, discrete GPUs before integrated ones; `None` selects the first
    /// that can render.
    pub index: Option<usize>,
}

/// Returns the number of samples per pixel along each axis.
pub(crate) const fn samples_per_axis(samples: Samples) -> u32 {
    match samples {
        Samples::One => 1,
        Samples::Four => 2,
    }
}
