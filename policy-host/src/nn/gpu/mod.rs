//! Neural network kernels for GPUs, on wgpu and Vulkan.
//!
//! Every kernel computes each value by a fixed sequence of operations: one tile size for all batches, sums in
//! the order of their terms, reductions as trees of fixed shape. So the bits of a sample do not depend on its
//! batch. They may differ between devices and drivers, which may or may not fuse products and sums.
//!
//! [`adapters`] lists what there is, [`device`] opens one, [`buffer`] owns device memory, [`weights`] the
//! matrices in it, [`kernel`] compiles the WGSL sources, [`ops`] and [`sequences`] have one constructor per
//! layer, [`steps`] encodes them, and [`transfer`] has the batches in flight.

pub mod adapters;
pub mod buffer;
pub mod device;
pub mod kernel;
pub mod ops;
pub mod sequences;
pub mod steps;
pub mod transfer;
pub mod weights;

pub use self::adapters::DeviceKind;
pub use self::buffer::DeviceBuffer;
pub use self::device::{GpuDevice, GpuError};
pub use self::kernel::{Dispatch, KernelCache};
