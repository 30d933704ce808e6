//! Jointed bodies: motion along the joint axis, friction and joint limits.

use core::f64::consts::FRAC_PI_2;

use sim::scene::{Body, JointKind, JointSpec, Motion, Scene};

use super::common::{after, bodies_only, brick};

/// Weight of a brick with half extents of 0.05 m, in N.
const WEIGHT_N: f64 = 9.81;

/// Returns a brick of 1 kg on a vertical slide joint that points down.
fn sinking(friction: f64) -> Body {
    let axis = [0.0, 0.0, -1.0];
    let rail = JointSpec { kind: JointKind::Slide, axis, upper: 0.3, damping: 5.0, friction };
    brick("brick", Motion::Jointed(rail), [0.05; 3], [0.0, 0.0, 1.0])
}

/// Returns the joint position of the first body and its downward displacement, in m, after two seconds.
fn travel(scene: &Scene) -> [f64; 2] {
    let world = after(scene, 40);
    let sunk = scene.bodies[0].pose.translation.z - f64::from(world.body_pose(0).translation.z);
    [f64::from(world.joint_position(0)), sunk]
}

#[test]
fn slide_stops_at_its_limit() {
    let [position, sunk] = travel(&bodies_only(vec![sinking(0.0)]));
    assert!((position - 0.3).abs() < 2e-3, "at {position} m");
    assert!((position - sunk).abs() < 1e-4, "it moved along its axis, {position} and {sunk} m");
}

#[test]
fn dry_friction_holds_lighter_bodies() {
    let [held, _] = travel(&bodies_only(vec![sinking(1.2 * WEIGHT_N)]));
    assert!(held.abs() < 1e-3, "slipped by {held} m");
    let [slipped, _] = travel(&bodies_only(vec![sinking(0.8 * WEIGHT_N)]));
    assert!(slipped > 0.1, "moved by {slipped} m only");
}

#[test]
fn hinge_rotates_about_its_origin_to_its_limit() {
    let (axis, upper) = ([0.0, 1.0, 0.0], FRAC_PI_2);
    let hinge = JointSpec { kind: JointKind::Hinge, axis, upper, damping: 1.0, friction: 0.0 };
    let mut door = brick("door", Motion::Jointed(hinge), [0.05; 3], [0.0, 0.0, 1.0]);
    door.parts[0].pose.translation.x = 0.2;
    let world = after(&bodies_only(vec![door]), 100);
    let (angle, pose) = (f64::from(world.joint_position(0)), world.body_pose(0));
    assert!((angle - FRAC_PI_2).abs() < 0.02, "turned by {angle} rad");
    let origin = pose.translation.vector - nalgebra::Vector3::new(0.0, 0.0, 1.0);
    assert!(origin.norm() < 1e-3, "the hinge moved by {origin}");
    assert!((f64::from(pose.rotation.angle()) - angle).abs() < 1e-3);
}

#[test]
fn jointed_body_passes_fixed_but_carries_free_bodies() {
    let fixed = brick("fixed", Motion::Fixed, [0.2, 0.2, 0.02], [0.0, 0.0, 0.9]);
    let [passed, _] = travel(&bodies_only(vec![sinking(0.0), fixed]));
    assert!(passed > 0.29, "stuck at {passed} m");
    // Friction supports the brick and half the load. With the full load the brick sinks, and the load stays
    // on top of it.
    let load = brick("load", Motion::Dynamic, [0.05; 3], [0.0, 0.0, 1.1]);
    let loaded = bodies_only(vec![sinking(1.5 * WEIGHT_N), load]);
    let [sunk, _] = travel(&loaded);
    let world = after(&loaded, 40);
    let gap = world.body_pose(1).translation.z - world.body_pose(0).translation.z;
    assert!(sunk > 0.05 && (gap - 0.1).abs() < 2e-3, "sunk {sunk} m, the load {gap} m above");
}

#[test]
fn free_body_has_joint_position_zero() {
    let world = after(&bodies_only(vec![brick("free", Motion::Dynamic, [0.05; 3], [0.0, 0.0, 0.05])]), 2);
    assert_eq!(world.joint_position(0), 0.0);
}

#[test]
fn overlap_is_reported_as_penetration() {
    let bricks = [0.05, 0.14].map(|z| brick("brick", Motion::Dynamic, [0.05; 3], [0.0, 0.0, z]));
    let overlap = after(&bodies_only(bricks.to_vec()), 1).max_penetration();
    assert!((0.002..0.011).contains(&overlap), "placed 10 mm deep, found {overlap} m after a step");
}

#[test]
fn set_state_moves_a_body_along_its_joint() {
    let (axis, upper) = ([0.0, 1.0, 0.0], FRAC_PI_2);
    let hinge = JointSpec { kind: JointKind::Hinge, axis, upper, damping: 1.0, friction: 0.0 };
    let mut door = brick("door", Motion::Jointed(hinge), [0.05; 3], [0.0, 0.0, 1.0]);
    door.parts[0].pose.translation.x = 0.2;
    for body in [door, sinking(0.0)] {
        let scene = bodies_only(vec![body]);
        let moving = after(&scene, 4);
        let mut world = after(&scene, 0);
        world.set_state(&moving.state());
        let (position, expected) = (world.joint_position(0), moving.joint_position(0));
        assert!(expected > 0.01 && (position - expected).abs() < 1e-5, "at {position}, not {expected}");
        world.step(&[]);
        let continued = after(&scene, 5).joint_position(0);
        let reached = world.joint_position(0);
        // The velocity that rapier reports for a body on a joint is that of the physics step before.
        let tolerance = 0.05 * (continued - expected);
        assert!((reached - continued).abs() < tolerance, "from {expected} to {reached}, not to {continued}");
    }
}
