//! Conversions between nalgebra types (used in this crate) and glam types (used by rapier).

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rapier3d::math::{Pose, Rotation, Vector};

pub(crate) fn to_vector(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x as f32, v.y as f32, v.z as f32)
}

pub(crate) fn to_pose(pose: &Isometry3<f64>) -> Pose {
    let q = pose.rotation.coords;
    let rotation = Rotation::from_xyzw(q.x as f32, q.y as f32, q.z as f32, q.w as f32).normalize();
    Pose::from_parts(to_vector(&pose.translation.vector), rotation)
}

pub(crate) fn from_vector(v: Vector) -> Vector3<f32> {
    Vector3::new(v.x, v.y, v.z)
}

/// Converts a pose without normalising the sign of its quaternion, so that the quaternion of a rotating link
/// stays continuous.
pub(crate) fn from_pose(pose: &Pose) -> Isometry3<f32> {
    let r = pose.rotation;
    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(r.w, r.x, r.y, r.z));
    Isometry3::from_parts(Translation3::from(from_vector(pose.translation)), rotation)
}
