//! π0.5, a vision-language-action model (Physical Intelligence: π0.5: a vision-language-action model with
//! open-world generalization, 2025): the network in [`model`], the policies around it in `policy` on the
//! CPU and in `gpu`.

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

use self::architecture::MAX_STEPS;
#[cfg(feature = "gpu")]
pub use self::gpu::GpuPi05Network;
#[cfg(feature = "gpu")]
use self::gpu::GpuPi05Policy;
use self::policy::Pi05Policy;
use super::family::NetworkFamily;
use crate::nn::Precision;

/// The definition of the family.
pub(crate) const FAMILY: NetworkFamily = NetworkFamily {
    name: "pi05",
    precisions: &[Precision::F32, Precision::Int8],
    max_steps: Some(MAX_STEPS),
    maps_weights: true,
    // On a CPU, a query at full size takes up to half a minute.
    answer_timeout_s: Some(3600),
    check: policy::check,
    long_prompts: policy::long_prompts,
    load: |source, _, robots, _| Ok(Box::new(Pi05Policy::load(source, robots)?)),
    #[cfg(feature = "gpu")]
    load_on_gpu: |source, gpu, robots, _| Ok(Box::new(GpuPi05Policy::load(source, gpu, robots)?)),
};
