//! π0.5, a vision-language-action model (Physical Intelligence: π0.5: a vision-language-action model with
//! open-world generalization, 2025): the network in [`model`], the policy around it in [`Pi05Policy`] on the
//! CPU.

pub mod architecture;
pub mod checkpoint;
pub mod image;
pub mod model;
pub mod processor;

mod expert;
mod gemma;
#[cfg(feature = "gpu")]
mod gpu;
mod layers;
mod policy;
mod siglip;

#[cfg(feature = "gpu")]
pub use self::gpu::{GpuPi05Network, GpuPi05Policy};
pub use self::policy::{Pi05Policy, check, long_prompts};
