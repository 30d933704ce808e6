//! Opening of a device for a visibility method.

use core::time::Duration;

use gpu::{AdapterKind, DeviceRequirements, GpuDevice, GpuError, adapters};

use super::options::{GpuOptions, VisibilityMethod};
use crate::renderer::{OpenRendererError, RenderError};

/// NVIDIA data-centre GPUs. They have few rasterisation units relative to their compute throughput.
const COMPUTE_GPUS: [&str; 8] = ["A100", "A800", "H100", "H200", "H800", "B100", "B200", "B300"];

/// Opens an adapter by kind and index, with a visibility method that it supports.
///
/// # Errors
/// If there is none, or it does not meet all requirements.
pub(crate) fn open(
    kind: AdapterKind,
    options: &GpuOptions,
) -> Result<(GpuDevice, VisibilityMethod), OpenRendererError> {
    let methods = match options.visibility {
        Some(method) => [method; 2],
        None => preferred_methods(kind, options.index.unwrap_or(0)),
    };
    let open = |method: VisibilityMethod| {
        let gpu = GpuDevice::open(kind, options.index, &requirements(method))?;
        Ok::<_, GpuError>((gpu, method))
    };
    Ok(open(methods[0]).or_else(|error| open(methods[1]).map_err(|_| error))?)
}

fn requirements(visibility: VisibilityMethod) -> DeviceRequirements {
    let features = match visibility {
        VisibilityMethod::Raster => wgpu::Features::PRIMITIVE_INDEX | wgpu::Features::INDIRECT_FIRST_INSTANCE,
        VisibilityMethod::Compute => {
            wgpu::Features::SHADER_INT64 | wgpu::Features::SHADER_INT64_ATOMIC_MIN_MAX
        }
    };
    DeviceRequirements { features, max_buffer_bytes: u64::MAX, timeout: Duration::from_secs(60) }
}

/// Returns compute first for [`COMPUTE_GPUS`] and the rasteriser first for all others.
fn preferred_methods(kind: AdapterKind, index: usize) -> [VisibilityMethod; 2] {
    let prefers_compute = adapters().iter().any(|adapter| {
        let is_same = adapter.kind == kind && adapter.index == index;
        is_same && COMPUTE_GPUS.iter().any(|gpu| adapter.name.contains(gpu))
    });
    match prefers_compute {
        true => [VisibilityMethod::Compute, VisibilityMethod::Raster],
        false => [VisibilityMethod::Raster, VisibilityMethod::Compute],
    }
}

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
