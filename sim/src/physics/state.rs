//! The dynamic state of a world, to be read, stored and set again.

use nalgebra::{Isometry3, Vector3};

use scene::robot::panda::N_DOFS;

/// Joint positions and velocities of an arm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmState {
    /// Positions of joints 1 to 7 (rad) and of both fingers (m).
    pub qpos: [f32; N_DOFS],
    /// Velocities of joints 1 to 7 (rad/s) and of both fingers (m/s).
    pub qvel: [f32; N_DOFS],
}

/// Pose and velocity of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyState {
    /// World pose of the body's frame.
    pub pose: Isometry3<f32>,
    /// World velocity of the centre of mass, in m/s.
    pub linear_velocity: Vector3<f32>,
    /// World angular velocity, in rad/s.
    pub angular_velocity: Vector3<f32>,
}

/// State of all arms and bodies of a world. It does not contain the impulses from which the contact solver
/// starts, so a world that continues from a copied state may differ in the last bits.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldState {
    /// One state per arm.
    pub arms: Vec<ArmState>,
    /// One state per body, in the order of the scene's bodies.
    pub bodies: Vec<BodyState>,
}
