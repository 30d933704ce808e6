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
pub use self::policy::ActPolicy;
use super::family::NetworkFamily;
use crate::nn::Precision;

/// The definition of the family.
pub(crate) const FAMILY: NetworkFamily = NetworkFamily {
    name: "act",
    precisions: &[Precision::F32, Precision::Int8],
    max_steps: None,
    maps_weights: false,
    answer_timeout_s: None,
    check: policy::check,
    long_prompts: |_, _| Ok(Vec::new()),
    load: |source, n_threads, robots, images| {
        Ok(Box::new(ActPolicy::load(source, n_threads, robots, images)?))
    },
    #[cfg(feature = "gpu")]
    load_on_gpu: |source, gpu, robots, images| {
        Ok(Box::new(GpuActPolicy::load(gpu, &source.folder, robots, images)?))
    },
};
