//! Neural network kernels for GPUs, on wgpu and Vulkan.
//!
//! Every kernel computes each value by a fixed sequence of operations: one tile size for all batches, sums in
//! the order of their terms, reductions as trees of fixed shape. So the bits of a sample do not depend on its
//! batch. They may differ between devices and drivers, which may or may not fuse products and sums.
//!
//! [`device`] opens a device, [`weights`] owns the matrices in its memory, [`kernel`] compiles the WGSL
//! sources, [`ops`] and [`sequences`] have one constructor per layer, [`steps`] encodes them, and
//! [`transfer`] has the batches in flight.

pub mod device;
pub mod kernel;
pub mod ops;
pub mod sequences;
pub mod steps;
pub mod transfer;
pub mod weights;

pub use gpu::{AdapterKind, DeviceBuffer, GpuDevice, GpuError, adapters};

pub use self::device::open;
pub use self::kernel::{Dispatch, KernelCache};
