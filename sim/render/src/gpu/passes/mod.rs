//! Kernels that render a chunk of views, and their buffers.

pub(crate) mod buffers;
pub(crate) mod kernels;
pub(crate) mod pipeline;
