//! ACT, the action chunking transformer (Zhao et al., Learning fine-grained bimanual manipulation with
//! low-cost hardware, 2023): the network in [`model`], the policy around it in [`ActPolicy`].

pub mod architecture;
pub mod image;
pub mod model;
pub mod normalise;
pub mod tensors;

mod backbone;
mod flop;
#[cfg(feature = "gpu")]
mod gpu;
mod inputs;
mod instruction;
mod leading;
mod policy;
mod position;
mod stored;
mod team;
mod transformer;

#[cfg(feature = "gpu")]
pub use gpu::GpuActPolicy;
pub use image::IMAGE_SIZES;
pub use policy::{ActPolicy, check};
