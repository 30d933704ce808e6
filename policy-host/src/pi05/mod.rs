//! π0.5, a vision-language-action model (Physical Intelligence: π0.5: a vision-language-action model with
//! open-world generalization, 2025): the network in [`model`], the policy around it in [`Pi05Policy`] on the
//! CPU.

pub mod architecture;
pub mod image;
pub mod model;
pub mod prompt;
pub mod scaling;

mod attention;
mod expert;
mod flop;
mod gemma;
#[cfg(feature = "gpu")]
mod gpu;
mod policy;
mod processor;
mod rows;
mod sampler;
mod siglip;
mod weights;

#[cfg(feature = "gpu")]
pub use gpu::{GpuPi05Network, GpuPi05Policy};
pub use policy::{Pi05Policy, check, long_prompts};
