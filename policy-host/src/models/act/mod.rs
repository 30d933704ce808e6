//! ACT, the action chunking transformer (Zhao et al., Learning fine-grained bimanual manipulation with
//! low-cost hardware, 2023): the network in [`model`], the policy around it in [`ActPolicy`].

pub mod architecture;
pub mod checkpoint;
pub mod image;
pub mod model;

mod backbone;
#[cfg(feature = "gpu")]
mod gpu;
mod leading;
mod policy;
mod team;
mod transformer;

#[cfg(feature = "gpu")]
pub use self::gpu::GpuActPolicy;
pub use self::image::IMAGE_SIZES;
pub use self::policy::{ActPolicy, check};
