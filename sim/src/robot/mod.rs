//! The Franka Panda: its model, kinematics and controllers.
//!
//! All functions are pure f64 functions of joint positions, independent of scenes, tasks, policies and the
//! physics engine. Trigonometry goes through nalgebra, which is built with the `libm` crate, so results do
//! not depend on the system's libm.

pub mod control;
pub mod dynamics;
pub mod ik;
pub mod kinematics;
pub mod panda;
