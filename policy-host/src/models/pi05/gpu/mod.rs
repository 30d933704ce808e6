//! π0.5 on a GPU: the same network as [`super::model`], as runs of steps that are encoded for each batch.
//!
//! The vision tower counts distinct images, the language model the rows of all prefixes, which follow each
//! other without padding, and attention and the action expert count samples.

mod expert;
mod gemma;
mod network;
mod policy;
mod runs;
mod vision;

pub use network::GpuPi05Network;
pub(crate) use policy::GpuPi05Policy;
