//! The Franka Panda: its facts, its kinematics and its controllers.
//!
//! Kinematics and control are plain f64 functions of joint positions; only [`arm`] knows rapier, as the multibody that is
//! stepped. Nothing here knows scenes, tasks or policies.

pub(crate) mod arm;
pub mod control;
pub mod ik;
pub mod kinematics;
pub mod panda;
