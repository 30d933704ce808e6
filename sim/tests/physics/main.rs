//! The robot and its physics through the crate's public door: scenes, kinematics, control modes, worlds, joints,
//! predicates, profiles, plans, demonstrations.

mod common;
mod control;
mod demos;
mod joints;
mod kinematics;
mod plans;
mod predicates;
mod profiles;
mod scenes;
mod worlds;
