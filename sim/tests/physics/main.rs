//! Tests of robot and physics through the public API: scenes, kinematics, control modes, worlds, joints,
//! predicates, profiles, plans and demonstrations.

mod common;
mod control;
mod demos;
mod distractors;
mod joints;
mod kinematics;
mod limits;
mod objects;
mod plans;
mod predicates;
mod profiles;
mod scenes;
mod worlds;
