//! Parameters of contacts, fitted to recorded motions of the original.

use rapier3d::dynamics::{FrictionModel, IntegrationParameters, SpringCoefficients};
use serde::{Deserialize, Serialize};

/// Unit of length to which rapier's tolerances refer, in m: objects measure centimetres, not metres.
const LENGTH_UNIT_M: f32 = 0.1;

/// Parameters of contacts. The benchmark `agreement` measures how well any other choice reproduces recorded
/// motions of the original; every run uses the default. It was chosen over 300 starts near those of 50
/// recordings, because single outcomes hang on fractions of a millimetre.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Parameters {
    /// Friction coefficient of the fingers. The original has 2.0, but the two anchors of its friction patches
    /// resist less to turning than the four contact points of a face here.
    pub finger_friction: f32,
    /// Normal force of a finger's contact up to which its friction is that of a weak grip, in N. From 1.5
    /// times this force on it is [`Self::finger_friction`].
    pub weak_grip_n: f32,
    /// Friction coefficient of a finger in a weak grip under which a body spins: its value at 0 rad/s, and
    /// the increase per rad/s. The original lets a weakly held body turn slowly, whereas under Coulomb
    /// friction it either sticks or swings.
    pub weak_grip_friction: [f32; 2],
    /// Spin below which the coefficient of a weak grip returns to [`Self::finger_friction`], in rad/s.
    pub stick_spin: f32,
    /// Stiffness of finger contacts, relative to other contacts. It is below 1 because the original's fingers
    /// sink into what they squeeze: they stop at 18.3 mm on a cube of 40 mm.
    pub finger_stiffness: f32,
    /// Natural frequency of contacts, in Hz.
    pub contact_hz: f32,
    /// Natural frequency of contacts with fixed bodies, in Hz.
    pub static_contact_hz: f32,
    /// Damping ratio of contacts.
    pub contact_damping: f32,
    /// Distance below which contacts are predicted, in m, as in the original. It lets a falling body stop on
    /// all of its lowest corners at once.
    pub prediction_m: f32,
    /// Solver substeps, 1 or 2, of a physics step in which an arm is near another body. Each recomputes the
    /// full dynamics of the arm, which is most of the cost of a step.
    pub substeps: usize,
    /// Contact iterations in each substep.
    pub iterations: usize,
    /// Contact iterations in each substep without recovery from penetration.
    pub relaxations: usize,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            finger_friction: 1.2,
            weak_grip_n: 8.0,
            weak_grip_friction: [0.2, 1.8],
            stick_spin: 0.25,
            finger_stiffness: 0.25,
            contact_hz: 120.0,
            static_contact_hz: 80.0,
            contact_damping: 10.0,
            prediction_m: 0.015,
            substeps: 2,
            iterations: 3,
            relaxations: 6,
        }
    }
}

impl Parameters {
    /// Returns rapier's parameters for `physics_hz` steps per second.
    pub(crate) fn integration(&self, physics_hz: u32) -> IntegrationParameters {
        let contact =
            |natural_frequency| SpringCoefficients { natural_frequency, damping_ratio: self.contact_damping };
        IntegrationParameters {
            dt: 1.0 / physics_hz as f32,
            num_solver_iterations: self.substeps,
            num_internal_pgs_iterations: self.iterations,
            num_internal_stabilization_iterations: self.relaxations,
            contact_softness: contact(self.contact_hz),
            static_contact_softness: contact(self.static_contact_hz),
            length_unit: LENGTH_UNIT_M,
            normalized_prediction_distance: self.prediction_m / LENGTH_UNIT_M,
            // Contact recycling tolerates motions larger than these objects.
            contact_recycling: false,
            friction_in_bias_pass: false,
            // The simplified model resists turning on a face more than the original does.
            friction_model: FrictionModel::Coulomb,
            ..IntegrationParameters::default()
        }
    }
}
