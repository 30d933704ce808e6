//! Solver settings for contact-rich manipulation.
//!
//! With rapier's defaults, fingers that squeeze with 30 N sink 7 mm into a 4 cm cube. All values here were
//! tuned by measuring grasps, insertions and stacks.

use rapier3d::dynamics::{IntegrationParameters, SpringCoefficients};

use super::{CONTROL_HZ, SUBSTEPS};

/// Solver substeps of a physics step in which an arm is near another body or at a joint limit. Each substep
/// recomputes the full dynamics of the arm, which is most of the cost of a step; the cheap contact iterations
/// compensate for the small number of substeps.
pub(super) const CONTACT_SUBSTEPS: usize = 2;
/// Solver substeps while no arm is near anything, so that only the drives act.
pub(super) const FREE_SUBSTEPS: usize = 1;

/// Returns the integration parameters: 100 Hz, with eight contact iterations in each of [`CONTACT_SUBSTEPS`]
/// substeps.
pub(super) fn parameters() -> IntegrationParameters {
    let contact = |natural_frequency| SpringCoefficients { natural_frequency, damping_ratio: 10.0 };
    IntegrationParameters {
        dt: (1.0 / (CONTROL_HZ * SUBSTEPS as f64)) as f32,
        num_solver_iterations: CONTACT_SUBSTEPS,
        num_internal_pgs_iterations: 8,
        num_internal_stabilization_iterations: 2,
        contact_softness: contact(120.0),
        static_contact_softness: contact(240.0),
        // Objects measure centimetres, not metres.
        length_unit: 0.1,
        // Contact recycling tolerates motions larger than these objects.
        contact_recycling: false,
        friction_in_bias_pass: false,
        ..IntegrationParameters::default()
    }
}
