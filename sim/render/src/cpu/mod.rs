//! The CPU renderer: a visibility pass finds the nearest triangle of each pixel, then a deferred shading pass
//! visits every pixel once and writes its bytes directly to the memory from which the policy reads them.
//!
//! Both passes process sixteen triangles or pixels at a time, in code generic over [`simd::Simd`] that
//! [`simd::isa`] compiles once per instruction set.

mod cache;
mod inspect;
mod renderer;
mod settings;
mod shading;
mod shadow;
mod simd;
mod transform;
mod view_passes;
mod visibility;
mod workspace;

pub use inspect::{Inspection, Segment};
pub use renderer::CpuRenderer;
pub use settings::CpuOptions;
