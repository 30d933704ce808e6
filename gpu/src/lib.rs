//! Vulkan devices on wgpu: selection, opening and failures, buffers, pipelines, and waiting for results.
//!
//! Owns what the GPU renderer and the policies on a GPU have in common. It knows neither images nor networks,
//! and has no kernel of its own.

mod adapter;
mod buffer;
mod device;
mod pipeline;
mod submission;

pub use adapter::{AdapterKind, AdapterSummary, adapters};
pub use buffer::{DeviceBuffer, GrowableBuffer};
pub use device::{DeviceRequirements, GpuDevice, GpuError};
pub use pipeline::{bind_group, compute_pipeline};
pub use submission::{PendingSubmission, read_mapped};
