//! Requirements of the device, and its errors as those of a renderer.

use core::time::Duration;

use gpu::{DeviceRequirements, GpuError};

use crate::renderer::{OpenRendererError, RenderError};

/// Needs of the kernels: the visibility kernel keeps 1/z and triangle id in one 64-bit word.
pub(crate) const REQUIREMENTS: DeviceRequirements = DeviceRequirements {
    features: wgpu::Features::SHADER_INT64.union(wgpu::Features::SHADER_INT64_ATOMIC_MIN_MAX),
    max_buffer_bytes: u64::MAX,
    timeout: Duration::from_secs(60),
};

impl From<GpuError> for OpenRendererError {
    fn from(error: GpuError) -> Self {
        match error {
            GpuError::NoAdapter { wanted, found } => Self::NoAdapter { wanted, found },
            GpuError::Device { name, message } => Self::Device { name, message },
        }
    }
}

impl From<GpuError> for RenderError {
    fn from(error: GpuError) -> Self {
        match error {
            GpuError::NoAdapter { wanted: name, found: message } | GpuError::Device { name, message } => {
                Self::Device { name, message }
            }
        }
    }
}
