//! What stands in a scene besides the arms: its bodies, the table and the floor.

use nalgebra::{Isometry3, Translation3};
use rapier3d::dynamics::{RigidBodyBuilder, RigidBodyHandle};
use rapier3d::geometry::{ColliderBuilder, SharedShape};
use rapier3d::math::{Rotation, Vector};
use rapier3d::pipeline::PhysicsWorld;

use super::convert::to_pose;
use crate::scene::{Body, Motion, Primitive, TableKind};

/// Least mass of a body that moves, in kg: contact stiffness follows mass, and a few grams are crushed by the gripper.
const LEAST_MASS_KG: f64 = 0.025;
/// Friction of table and floor.
const GROUND_FRICTION: f32 = 0.3;
/// World z of the floor, in m.
const FLOOR_Z: f64 = -0.9196;

/// A collider for a solid at a pose in its parent's frame.
pub(super) fn collider(shape: Primitive, pose: &Isometry3<f64>) -> ColliderBuilder {
    let f = |x: f64| x as f32;
    let upright = Rotation::from_rotation_x(core::f32::consts::FRAC_PI_2);
    let mut placed = to_pose(pose);
    let shape = match shape {
        Primitive::Box { half: [x, y, z] } => SharedShape::cuboid(f(x), f(y), f(z)),
        Primitive::Ball { radius } => SharedShape::ball(f(radius)),
        Primitive::Capsule { radius, half_height } => {
            let end = Vector::new(0.0, 0.0, f(half_height));
            SharedShape::capsule(-end, end, f(radius))
        }
        Primitive::Cylinder { radius, half_height } => {
            // rapier's cylinders stand along y.
            placed.rotation *= upright;
            SharedShape::cylinder(f(half_height), f(radius))
        }
    };
    ColliderBuilder::new(shape).position(placed)
}

/// Adds a body at its drawn pose.
pub(super) fn add_body(world: &mut PhysicsWorld, body: &Body) -> RigidBodyHandle {
    let builder = match body.motion {
        Motion::Dynamic => RigidBodyBuilder::dynamic(),
        Motion::Fixed | Motion::Mark => RigidBodyBuilder::fixed(),
    };
    let handle = world.insert_body(builder.pose(to_pose(&body.pose)));
    if body.motion == Motion::Mark {
        return handle;
    }
    let mass: f64 = body.parts.iter().map(|part| volume(part.shape) * body.density).sum();
    let density = body.density * (LEAST_MASS_KG / mass).max(1.0);
    for part in &body.parts {
        let solid = collider(part.shape, &part.pose).density(density as f32).friction(body.friction as f32);
        world.insert_collider(solid, Some(handle));
    }
    handle
}

/// Adds floor and table (spec/env.md §2). Walls are only seen: a look must never change a trajectory.
pub(super) fn add_ground(world: &mut PhysicsWorld, table: TableKind) {
    let mut block = |half: [f64; 3], centre: [f64; 3]| {
        let pose = Isometry3::from(Translation3::from(centre));
        world.insert_collider(collider(Primitive::Box { half }, &pose).friction(GROUND_FRICTION), None);
    };
    block([5.0, 5.0, 0.5], [0.0, 0.0, FLOOR_Z - 0.5]);
    block([0.6045, 1.209, -FLOOR_Z / 2.0], [-0.12, 0.0, FLOOR_Z / 2.0]);
    match table {
        TableKind::SingleArm => {}
        TableKind::Bimanual => block([0.6, 0.8, 0.025], [0.0, 0.0, 0.8]),
    }
}

/// In m³.
fn volume(shape: Primitive) -> f64 {
    use core::f64::consts::PI;
    match shape {
        Primitive::Box { half } => 8.0 * half.iter().product::<f64>(),
        Primitive::Cylinder { radius, half_height } => 2.0 * PI * radius * radius * half_height,
        Primitive::Ball { radius } => 4.0 / 3.0 * PI * radius.powi(3),
        Primitive::Capsule { radius, half_height } => {
            PI * radius * radius * (2.0 * half_height + 4.0 / 3.0 * radius)
        }
    }
}
