//! Opening of a device for networks.

use core::time::Duration;

use gpu::{AdapterKind, DeviceRequirements, GpuDevice, GpuError};

/// Needs of the kernels. Indices are 32-bit, and a batch of a large network takes minutes on a slow device.
const REQUIREMENTS: DeviceRequirements = DeviceRequirements {
    features: wgpu::Features::empty(),
    max_buffer_bytes: 1 << 31,
    timeout: Duration::from_secs(300),
};

/// Opens an adapter of a kind by its index among those of its kind, or the first that can compute networks.
///
/// # Errors
/// If there is none, which lists what was found, or the driver rejects the request.
pub fn open(kind: AdapterKind, index: Option<usize>) -> Result<GpuDevice, GpuError> {
    GpuDevice::open(kind, index, &REQUIREMENTS)
}
