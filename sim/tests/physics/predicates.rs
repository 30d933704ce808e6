//! Predicates on both sides of their thresholds.

use core::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{UnitQuaternion, Vector3};
use sim::physics::World;
use sim::predicate::{Predicate, Region};
use sim::scene::{Body, JointKind, JointSpec, Motion};

use super::common::{after, bodies_only, brick};

const HALF: [f64; 3] = [0.02, 0.03, 0.04];

/// Returns a fixed brick at a position (m), rotated about z by `yaw` (rad).
fn fixed_brick(position: [f64; 3], yaw: f64) -> Body {
    let mut body = brick("brick", Motion::Fixed, HALF, position);
    body.pose.rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    body
}

fn world(bodies: Vec<Body>) -> World {
    after(&bodies_only(bodies), 1)
}

#[test]
fn moved_counts_both_directions_along_its_axis() {
    let world = world(vec![fixed_brick([0.1, 0.0, 0.5], 0.0)]);
    let moved = |from: [f64; 3], along| Predicate::Moved { body: 0, from, along, by_m: 0.2 }.holds(&world);
    assert!(moved([0.1, 0.0, 0.29], [0.0, 0.0, 1.0]) && moved([0.1, 0.0, 0.71], [0.0, 0.0, 1.0]));
    assert!(!moved([0.1, 0.0, 0.31], [0.0, 0.0, 1.0]) && !moved([0.1, 0.0, 0.2], [1.0, 0.0, 0.0]));
}

#[test]
fn inside_box_in_world_or_body_frame() {
    let world = world(vec![fixed_brick([0.3, 0.1, 0.5], 0.0), fixed_brick([0.1, 0.1, 0.5], FRAC_PI_2)]);
    let holds = |of, point, min, max| {
        Predicate::Inside { body: 0, point, of, region: Region::Box { min, max } }.holds(&world)
    };
    assert!(Predicate::inside_box(0, [0.29, 0.0, f64::NEG_INFINITY], [0.31, 0.2, 1.0]).holds(&world));
    assert!(!Predicate::inside_box(0, [0.31, 0.0, 0.0], [0.4, 0.2, 1.0]).holds(&world));
    // The x axis of body 1 is world y, so body 0 is 0.2 m to its right, and the tested point 0.05 m farther.
    assert!(holds(Some(1), [0.0; 3], [-0.01, -0.21, -0.01], [0.01, -0.19, 0.01]));
    assert!(!holds(Some(1), [0.05, 0.0, 0.0], [-0.01, -0.21, -0.01], [0.01, -0.19, 0.01]));
    assert!(holds(Some(1), [0.05, 0.0, 0.0], [-0.01, -0.26, -0.01], [0.01, -0.24, 0.01]));
}

#[test]
fn inside_cylinder() {
    let world = world(vec![fixed_brick([0.3, 0.1, 0.5], 0.0)]);
    let holds = |radius, along| {
        let region = Region::Cylinder { origin: [0.0, 0.1, 0.46], axis: [1.0, 0.0, 0.0], radius, along };
        Predicate::Inside { body: 0, point: [0.0; 3], of: None, region }.holds(&world)
    };
    assert!(holds(0.041, [0.29, 0.31]));
    assert!(!holds(0.039, [0.29, 0.31]) && !holds(0.041, [0.31, 0.4]) && !holds(0.041, [-0.31, 0.29]));
}

#[test]
fn aligned_within_angles() {
    let world = world(vec![fixed_brick([0.0, 0.0, 0.5], 2.5)]);
    let holds = |angle_rad, either_way| {
        let axis = [1.0, 0.0, 0.0];
        Predicate::Aligned { body: 0, axis, with: axis, angle_rad, either_way }.holds(&world)
    };
    assert!(holds([2.4, PI], false) && !holds([0.0, 2.4], false));
    assert!(holds([0.6, 0.7], true) && !holds([0.0, 0.6], true), "ignoring the sign, the angle is 0.64 rad");
}

#[test]
fn at_a_pose() {
    let world = world(vec![fixed_brick([0.1, 0.2, 0.5], 0.3)]);
    let holds = |position: [f64; 3], yaw: f64| {
        let q = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
        let orientation = [q.w, q.i, q.j, q.k];
        Predicate::At { body: 0, position, orientation, tolerance: [0.005, 0.2] }.holds(&world)
    };
    assert!(holds([0.1, 0.2, 0.504], 0.11) && holds([0.1, 0.2, 0.5], 0.49));
    assert!(!holds([0.1, 0.2, 0.506], 0.3) && !holds([0.1, 0.2, 0.5], 0.51));
}

#[test]
fn opened_by_joint_position() {
    let (axis, damping) = ([0.0, 0.0, -1.0], 20.0);
    let joint = JointSpec { kind: JointKind::Slide, axis, upper: 0.2, damping, friction: 0.0 };
    let scene = bodies_only(vec![brick("drawer", Motion::Jointed(joint), HALF, [0.0, 0.0, 1.0])]);
    let opened = |world: &World, min_position| Predicate::Opened { body: 0, min_position }.holds(world);
    assert!(!opened(&after(&scene, 1), 0.1));
    let end = after(&scene, 100);
    assert!(opened(&end, 0.19) && !opened(&end, 0.21));
}
