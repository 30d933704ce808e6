//! GPU renderer on wgpu and Vulkan. A placement kernel derives the visible instances of every view, compute
//! kernels find the triangle of each pixel, another one shades it, and the packed bytes are copied into the
//! observation. `SHADING.md` defines the image.
//!
//! Scenes stay on the device for as long as their episodes last (`resident`). Views are rendered in chunks
//! (`chunk`): while the device renders one, the current rayon pool copies the images of the other. An image
//! depends only on its view and the device, not on the other views.

mod chunk;
mod device;
mod passes;
mod readback;
mod renderer;
mod resident;

pub use gpu::AdapterKind;
pub use renderer::{GpuRenderer, Timings};

#[cfg(test)]
mod tests;
