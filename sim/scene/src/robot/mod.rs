//! The Franka Panda: its model and kinematics.
//!
//! All functions are pure f64 functions of joint positions. Trigonometry goes through nalgebra, which is
//! built with the `libm` crate, so results do not depend on the system's libm.

pub mod kinematics;
pub mod panda;
