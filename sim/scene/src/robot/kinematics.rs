//! Forward kinematics and the geometric Jacobian of an arm, in the frame of its base.

use nalgebra::{Isometry3, SMatrix, SVector, UnitQuaternion, Vector3};

use super::panda::{N_JOINTS, joint_origin, tcp_in_link7};

/// Positions of joints 1 to 7, in rad.
pub type Joints = SVector<f64, N_JOINTS>;
/// TCP velocity per joint velocity: linear in rows 0 to 2, angular in rows 3 to 5.
pub type Jacobian = SMatrix<f64, 6, N_JOINTS>;

/// Returns the poses of links 1 to 7 in the frame of link 0.
#[must_use]
pub fn links(q: &Joints) -> [Isometry3<f64>; N_JOINTS] {
    let mut pose = Isometry3::identity();
    core::array::from_fn(|joint| {
        pose = pose * joint_origin(joint) * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), q[joint]);
        pose
    })
}

/// Returns the pose of the TCP in the frame of link 0.
#[must_use]
pub fn tcp(q: &Joints) -> Isometry3<f64> {
    links(q)[N_JOINTS - 1] * tcp_in_link7()
}

/// Returns the pose of the TCP and its geometric Jacobian, both in the frame of link 0.
#[must_use]
pub fn tcp_and_jacobian(q: &Joints) -> (Isometry3<f64>, Jacobian) {
    let links = links(q);
    let tcp = links[N_JOINTS - 1] * tcp_in_link7();
    let mut jacobian = Jacobian::zeros();
    for (joint, link) in links.iter().enumerate() {
        let axis = link.rotation * Vector3::z();
        let lever = tcp.translation.vector - link.translation.vector;
        jacobian.fixed_view_mut::<3, 1>(0, joint).copy_from(&axis.cross(&lever));
        jacobian.fixed_view_mut::<3, 1>(3, joint).copy_from(&axis);
    }
    (tcp, jacobian)
}

/// Returns the displacement from one pose to another: translation (m), then rotation vector (rad), in the
/// frame in which both poses are given.
#[must_use]
pub fn displacement(from: &Isometry3<f64>, to: &Isometry3<f64>) -> SVector<f64, 6> {
    let linear = to.translation.vector - from.translation.vector;
    let angular = (to.rotation * from.rotation.inverse()).scaled_axis();
    SVector::<f64, 6>::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
}
