//! Parameters of contacts, fitted to recorded motions of the original.

use serde::{Deserialize, Serialize};

/// Parameters of contacts. The benchmark `agreement` measures how well any other choice reproduces recorded
/// motions of the original; every run uses the default. It was chosen over 300 starts near those of 50
/// recordings, the numbers of iterations over 1,200, because single outcomes hang on fractions of a
/// millimetre.
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
    /// Substeps of a physics step in which an arm touches something; any other has one.
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
            iterations: 8,
            relaxations: 5,
        }
    }
}

impl Parameters {
    /// Returns the friction coefficient of a finger that presses with a normal force (N) on a body that spins
    /// under it about the normal (rad/s).
    pub(crate) fn friction_of_finger(&self, force: f32, spin: f32) -> f32 {
        let Self {
            finger_friction: strong,
            weak_grip_n,
            weak_grip_friction: [offset, per_spin],
            stick_spin,
            ..
        } = self;
        let weakness = (3.0 - 2.0 * force / weak_grip_n).clamp(0.0, 1.0);
        let slipping = offset + per_spin * spin.max(*stick_spin);
        let weak = strong + (slipping - strong) * (spin / stick_spin).min(1.0);
        strong + weakness * (weak - strong)
    }
}
