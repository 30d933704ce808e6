//! Policies: networks, one folder per family, and the policies without weights.

pub mod act;
pub mod idle;
pub mod pi05;
pub mod random;
pub mod robot_state;
pub mod synthetic;

#[cfg(feature = "gpu")]
mod gpu_error;
#[cfg(feature = "gpu")]
mod in_flight;
mod rows;

#[cfg(feature = "gpu")]
pub use self::gpu_error::LoadGpuError;
