//! ACT on a GPU: the same network as [`super::model`], as a list of steps that is encoded for each batch.

mod backbone;
mod layers;
mod network;
mod policy;
mod transformer;

pub use policy::GpuActPolicy;
