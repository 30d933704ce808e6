//! Solver settings with which rapier carries manipulation.
//!
//! Its defaults do not: under a gripper's 30 N they let the fingers sink 7 mm into a 4 cm cube. Every value here was found
//! by measuring grasps, insertions and stacks.

use rapier3d::dynamics::{IntegrationParameters, SpringCoefficients};

use super::{CONTROL_HZ, SUBSTEPS};

/// Solver substeps of a physics step in which an arm is near something or at a joint's stop. Each computes the arm's whole
/// dynamics anew, and that is most of a step's cost; sweeps over the contacts are cheap and make up for it.
pub(super) const CARE_SUBSTEPS: usize = 2;
/// The same while every arm moves through free air: there is only its drive to follow.
pub(super) const FREE_SUBSTEPS: usize = 1;

/// 100 Hz, [`CARE_SUBSTEPS`] of eight sweeps each.
pub(super) fn contacts() -> IntegrationParameters {
    let contact = |natural_frequency| SpringCoefficients { natural_frequency, damping_ratio: 10.0 };
    IntegrationParameters {
        dt: (1.0 / (CONTROL_HZ * SUBSTEPS as f64)) as f32,
        num_solver_iterations: CARE_SUBSTEPS,
        num_internal_pgs_iterations: 8,
        num_internal_stabilization_iterations: 2,
        contact_softness: contact(120.0),
        static_contact_softness: contact(240.0),
        // Objects are centimetres, not metres.
        length_unit: 0.1,
        // Recycled contacts tolerate more motion than these objects are long.
        contact_recycling: false,
        friction_in_bias_pass: false,
        ..IntegrationParameters::default()
    }
}
