//! The robot and its physics through the crate's public door: scenes, kinematics, control modes, worlds, joints,
//! predicates, plans.

mod common;
mod control;
mod joints;
mod kinematics;
mod plans;
mod predicates;
mod scenes;
mod worlds;
