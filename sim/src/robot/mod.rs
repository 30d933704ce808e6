//! The Franka Panda: its facts, its kinematics and its controllers.
//!
//! Plain f64 functions of joint positions. Nothing here knows scenes, tasks, policies or the physics engine; trigonometry
//! goes through nalgebra, which the workspace builds on a portable implementation, so results do not depend on the
//! system's mathematics library.

pub mod control;
pub mod ik;
pub mod kinematics;
pub mod panda;
