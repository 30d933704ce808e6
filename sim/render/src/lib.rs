//! Rendering: turns a [`Scene`](scene::Scene), prepared once per episode, and a
//! [`Snapshot`](scene::Snapshot) per image into sRGB bytes.
//!
//! Owns meshes, textures and the shading model. Never steps a world and never draws a random number. An image
//! depends on its scene, snapshot and camera alone, not on the batch or the number of threads. `cpu` gives
//! the same bytes on every machine; `gpu` gives the same bytes on one device, and nearly those of `cpu`. Both
//! follow `SHADING.md`.

mod cpu;
pub mod export;
#[cfg(feature = "gpu")]
pub mod gpu;
mod math;
mod mesh;
mod open;
mod prepared;
mod renderer;
mod shading;
mod texture;

pub use cpu::{CpuOptions, CpuRenderer, Inspection, Segment};
#[cfg(feature = "gpu")]
pub use gpu::GpuRenderer;
pub use open::open;
pub use prepared::RenderScene;
pub use renderer::{OpenRendererError, RenderError, Renderer, View};
pub use run_config::{RendererChoice, Samples};
