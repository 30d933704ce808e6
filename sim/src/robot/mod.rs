//! The Franka Panda's controllers, dynamics and inverse kinematics.
//!
//! All functions are pure f64 functions of joint positions, independent of scenes, tasks, policies and the
//! physics engine.

pub mod control;
pub mod dynamics;
pub mod ik;
