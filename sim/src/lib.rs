//! The simulator: samples scenes, steps their physics, renders observations, and serves them to policies over
//! the link.

#[cfg(test)]
#[path = "../../tests/counting.rs"]
mod counting;
pub mod demo;
pub mod episode;
pub mod expert;
pub mod perturb;
pub mod physics;
pub mod robot;
pub mod serve;
pub mod show;
pub mod task;
pub mod tasks;
pub mod trajectory;

pub use perturb::Perturbation;
pub use render;
pub use scene;
pub use task::predicate;
pub use task::profile::Profile;
pub use tasks::TaskId;
