//! Changes to the contacts of arms before they are solved.

use rapier3d::dynamics::RigidBodyHandle;
use rapier3d::geometry::ColliderHandle;
use rapier3d::math::Vector;
use rapier3d::pipeline::{ContactModificationContext, PhysicsHooks};

use super::Parameters;

/// Distance in m below which the contacts of arms are solved. Arms are slow, and each of their contacts costs
/// far more than one between free bodies.
pub(crate) const ARM_PREDICTION_M: f32 = 0.004;
/// User data of the colliders of fingers.
pub(crate) const FINGER: u128 = 1;

/// Drops distant contacts of arms, and changes stiffness and friction of those of fingers.
pub(crate) struct ArmContacts<'a> {
    pub(crate) parameters: &'a Parameters,
    /// Length of a physics step, in s.
    pub(crate) dt: f32,
}

impl ArmContacts<'_> {
    /// Returns the friction coefficient of a finger that presses with a normal force (N) on a body that spins
    /// under it about the normal (rad/s).
    fn friction(&self, force: f32, spin: f32) -> f32 {
        let Parameters {
            finger_friction: strong,
            weak_grip_n,
            weak_grip_friction: [offset, per_spin],
            stick_spin,
            ..
        } = self.parameters;
        let weakness = (3.0 - 2.0 * force / weak_grip_n).clamp(0.0, 1.0);
        let slipping = offset + per_spin * spin.max(*stick_spin);
        let weak = strong + (slipping - strong) * (spin / stick_spin).min(1.0);
        strong + weakness * (weak - strong)
    }
}

impl PhysicsHooks for ArmContacts<'_> {
    fn modify_solver_contacts(&self, context: &mut ContactModificationContext<'_>) {
        let is_finger = |handle: ColliderHandle| context.colliders[handle].user_data == FINGER;
        let is_soft = is_finger(context.collider1) || is_finger(context.collider2);
        let spin =
            |body: Option<RigidBodyHandle>| body.map_or(Vector::ZERO, |it| context.bodies[it].angvel());
        let spin = spin(context.rigid_body1) - spin(context.rigid_body2);
        let Some(manifold) = context.rigid_mut() else { return };
        manifold.solver_contacts.retain(|contact| contact.dist < ARM_PREDICTION_M);
        if is_soft {
            for contact in manifold.solver_contacts.iter_mut().filter(|contact| contact.dist < 0.0) {
                contact.dist *= self.parameters.finger_stiffness;
            }
            let force =
                manifold.manifold.points.iter().map(|point| point.data.impulse).sum::<f32>() / self.dt;
            // rapier's coefficient is the mean of the finger's and the body's.
            let change =
                self.friction(force, spin.dot(*manifold.normal).abs()) - self.parameters.finger_friction;
            *manifold.friction += change / 2.0;
        }
    }
}
