//! The robot and its physics through the crate's public door: scenes, kinematics, control modes, worlds, joints,
//! predicates, profiles, plans.

mod common;
mod control;
mod joints;
mod kinematics;
mod plans;
mod predicates;
mod profiles;
mod scenes;
mod worlds;
