//! Single-degree-of-freedom joints for rapier's multibodies, in which the free axis is always x of the joint
//! frame.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rapier3d::dynamics::{GenericJointBuilder, JointAxesMask, JointAxis};

use super::convert::to_pose;
use scene::JointKind;

/// Builds a joint that slides along or rotates about `direction` of the child's frame. `origin` is the
/// pose of the joint in the parent's frame, `limits` are its minimum and maximum position in m or rad, if
/// it has any.
///
/// # Panics
/// If the direction is −x.
pub(crate) fn single_dof_joint(
    kind: JointKind,
    origin: &Isometry3<f64>,
    direction: &Vector3<f64>,
    limits: Option<[f64; 2]>,
) -> GenericJointBuilder {
    let locked = match kind {
        JointKind::Slide => JointAxesMask::LOCKED_PRISMATIC_AXES,
        JointKind::Hinge => JointAxesMask::LOCKED_REVOLUTE_AXES,
    };
    let x_to_axis = UnitQuaternion::rotation_between(&Vector3::x(), direction).expect("no direction is −x");
    let joint = GenericJointBuilder::new(locked)
        .local_frame1(to_pose(&(origin * x_to_axis)))
        .local_frame2(to_pose(&Isometry3::from_parts(Vector3::zeros().into(), x_to_axis)));
    match limits {
        Some(limits) => joint.limits(axis(kind), limits.map(|limit| limit as f32)),
        None => joint,
    }
}

/// Returns the free axis of a joint.
pub(crate) const fn axis(kind: JointKind) -> JointAxis {
    match kind {
        JointKind::Slide => JointAxis::LinX,
        JointKind::Hinge => JointAxis::AngX,
    }
}

/// Returns the index of the joint position among the six coordinates that rapier stores per joint.
pub(crate) const fn coordinate_idx(kind: JointKind) -> usize {
    match kind {
        JointKind::Slide => 0,
        JointKind::Hinge => 3,
    }
}
