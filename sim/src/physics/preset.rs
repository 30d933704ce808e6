//! Solver settings with which rapier carries manipulation.
//!
//! Its defaults do not: under a gripper's 30 N they let the fingers sink 7 mm into a 4 cm cube. Every value here was found
//! by measuring grasps, insertions and stacks.

use rapier3d::dynamics::{IntegrationParameters, SpringCoefficients};

use super::{CONTROL_HZ, SUBSTEPS};

/// 100 Hz with four solver substeps of four sweeps each.
pub(super) fn good() -> IntegrationParameters {
    // Contacts stay stable below about 0.3 times the rate of the solver's substeps, here 400 Hz.
    let contact = |natural_frequency| SpringCoefficients { natural_frequency, damping_ratio: 10.0 };
    IntegrationParameters {
        dt: (1.0 / (CONTROL_HZ * SUBSTEPS as f64)) as f32,
        num_solver_iterations: 4,
        num_internal_pgs_iterations: 4,
        num_internal_stabilization_iterations: 1,
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
