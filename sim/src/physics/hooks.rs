//! Changes to the contacts of arms before they are solved.

use rapier3d::geometry::ColliderHandle;
use rapier3d::pipeline::{ContactModificationContext, PhysicsHooks};

/// Distance in m below which the contacts of arms are solved. Arms are slow, and each of their contacts costs
/// far more than one between free bodies.
pub(super) const ARM_PREDICTION_M: f32 = 0.004;
/// User data of the colliders of fingers.
pub(super) const FINGER: u128 = 1;

/// Drops distant contacts of arms and softens those of fingers.
pub(super) struct ArmContacts {
    /// Stiffness of finger contacts relative to others: the solver sees this part of their penetration.
    pub(super) finger_stiffness: f32,
}

impl PhysicsHooks for ArmContacts {
    fn modify_solver_contacts(&self, context: &mut ContactModificationContext<'_>) {
        let is_finger = |handle: ColliderHandle| context.colliders[handle].user_data == FINGER;
        let is_soft = is_finger(context.collider1) || is_finger(context.collider2);
        let Some(manifold) = context.rigid_mut() else { return };
        manifold.solver_contacts.retain(|contact| contact.dist < ARM_PREDICTION_M);
        if is_soft {
            for contact in manifold.solver_contacts.iter_mut().filter(|contact| contact.dist < 0.0) {
                contact.dist *= self.finger_stiffness;
            }
        }
    }
}
