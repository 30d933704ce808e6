//! GPU renderer on wgpu and Vulkan. A visibility pass finds the triangle of each pixel, a compute kernel
//! shades it, and the packed bytes are copied into the observation. `SHADING.md` defines the image.
//!
//! Scenes stay on the device for as long as their episodes last, and the device derives the visible instances
//! of every view from the poses. Views are rendered in chunks: while the device renders one, the current
//! rayon pool copies the images of the other. An image depends only on its view and the device, not on the
//! other views.

mod assets;
mod batch;
mod bindings;
mod chunk;
mod compute;
mod device;
mod options;
mod pipeline;
mod placement;
mod raster;
mod readback;
mod records;
mod renderer;
mod scenes;
mod shading;
mod shadow;
mod shared_buffers;
mod texture_layers;

pub use gpu::AdapterKind;
pub use options::{GpuOptions, VisibilityMethod};
pub use renderer::{GpuRenderer, Timings};

#[cfg(test)]
mod tests;
