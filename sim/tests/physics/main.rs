//! The robot and its physics through the crate's public door: kinematics, control modes, worlds, experts.

mod common;
mod control;
mod experts;
mod kinematics;
mod worlds;
