//! The bodies of a scene other than the arms, and the table and floor.

use nalgebra::{Isometry3, Translation3};
use rapier3d::dynamics::{MassProperties, RigidBodyBuilder};
use rapier3d::geometry::{ColliderBuilder, Group, InteractionGroups, InteractionTestMode, SharedShape};
use rapier3d::math::{Pose, Rotation, Vector};
use rapier3d::pipeline::PhysicsWorld;

use super::body::PhysicsBody;
use super::collision::hull::Hull;
use super::convert::to_pose;
use super::solver::GROUND;
use super::solver::point::{Kind, Tag};
use scene::{Body, Mass, Motion, Primitive, TableKind};

/// Minimum mass of a moving body, in kg. Contact stiffness scales with mass, so the gripper would penetrate a
/// body of a few grams.
const MIN_MASS_KG: f64 = 0.025;
/// Friction coefficient of table and floor.
const GROUND_FRICTION: f32 = 0.3;
/// Height of the floor in the world frame, in m.
const FLOOR_Z: f64 = -0.9196;
/// Distance of the walls' centre planes from the world's origin, and their height, in m.
const WALL_DISTANCE: f64 = 1.5;
const WALL_HEIGHT: f64 = 2.0;
/// Collision groups of fixed and of jointed bodies, which do not collide with each other.
const FIXED: Group = Group::GROUP_1;
const JOINTED: Group = Group::GROUP_2;
/// Collision groups of each arm's links, and of its hand and fingers.
pub(crate) const LINK: [Group; 2] = [Group::GROUP_3, Group::GROUP_5];
pub(crate) const HAND: [Group; 2] = [Group::GROUP_4, Group::GROUP_6];

/// Builds a collider of a shape at a pose in its parent's frame.
pub(crate) fn collider(
    shape: &Primitive,
    pose: &Isometry3<f64>,
    tag: Tag,
    groups: InteractionGroups,
) -> ColliderBuilder {
    let (shape, position) = placed_shape(shape, pose);
    ColliderBuilder::new(shape).position(position).user_data(tag.to_user_data()).collision_groups(groups)
}

fn placed_shape(shape: &Primitive, pose: &Isometry3<f64>) -> (SharedShape, Pose) {
    let f = |x: f64| x as f32;
    let upright = Rotation::from_rotation_x(core::f32::consts::FRAC_PI_2);
    let mut position = to_pose(pose);
    let shape = match *shape {
        Primitive::Box { half: [x, y, z] } => SharedShape::cuboid(f(x), f(y), f(z)),
        Primitive::Ball { radius } => SharedShape::ball(f(radius)),
        Primitive::Capsule { radius, half_height } => {
            let end = Vector::new(0.0, 0.0, f(half_height));
            SharedShape::capsule(-end, end, f(radius))
        }
        Primitive::Cylinder { radius, half_height } => {
            // The axis of rapier's cylinders is y.
            position.rotation *= upright;
            SharedShape::cylinder(f(half_height), f(radius))
        }
        Primitive::Hull { ref points } => {
            let points: Vec<Vector> = points.iter().map(|&[x, y, z]| Vector::new(f(x), f(y), f(z))).collect();
            Hull::shape(&points).expect("the points of a hull are not in one plane")
        }
    };
    (shape, position)
}

/// Adds a body at its start pose with its colliders. `thing` is its number in the world.
pub(crate) fn add_body(world: &mut PhysicsWorld, body: &Body, thing: usize) -> PhysicsBody {
    let (builder, groups, kind) = match body.motion {
        Motion::Dynamic => (RigidBodyBuilder::dynamic(), InteractionGroups::all(), Kind::Free),
        Motion::Jointed(_) => {
            (RigidBodyBuilder::dynamic(), collision_groups(JOINTED, !(FIXED | JOINTED)), Kind::Jointed)
        }
        Motion::Fixed | Motion::VisualOnly => {
            (RigidBodyBuilder::fixed(), collision_groups(FIXED, !JOINTED), Kind::Fixed)
        }
    };
    let mut builder = builder.pose(to_pose(&body.pose));
    if let Mass::Measured { kg, centre, inertia } = body.mass {
        builder = builder.additional_mass_properties(mass_properties(kg, centre, inertia));
    }
    let handle = world.insert_body(builder);
    if body.motion != Motion::VisualOnly {
        let density = match body.mass {
            Mass::Density(density) => {
                let mass: f64 = body.parts.iter().map(|part| volume(&part.shape) * density).sum();
                density * (MIN_MASS_KG / mass).max(1.0)
            }
            Mass::Measured { .. } => 0.0,
        };
        for part in &body.parts {
            let builder = collider(&part.shape, &part.pose, Tag::new(thing, 0, kind), groups);
            let builder = builder.density(density as f32).friction(body.friction as f32);
            world.insert_collider(builder, Some(handle));
        }
    }
    world.bodies[handle].recompute_mass_properties_from_colliders(&world.colliders);
    PhysicsBody::new(world, handle, body)
}

/// Returns the mass properties of a body of at least [`MIN_MASS_KG`].
fn mass_properties(kg: f64, centre: [f64; 3], inertia: [f64; 3]) -> MassProperties {
    let heavier = (MIN_MASS_KG / kg).max(1.0);
    let vector =
        |[x, y, z]: [f64; 3], by: f64| Vector::new((x * by) as f32, (y * by) as f32, (z * by) as f32);
    MassProperties::new(vector(centre, 1.0), (kg * heavier) as f32, vector(inertia, heavier))
}

/// Collision groups of a collider that belongs to `memberships` and collides with members of `filter`.
pub(crate) const fn collision_groups(memberships: Group, filter: Group) -> InteractionGroups {
    InteractionGroups::new(memberships, filter, InteractionTestMode::And)
}

/// Adds the floor, the table and the four walls of the room (docs/benchmark.md, "Scenes and objects").
///
/// The walls exist even where no background perturbation shows them: appearance never affects a trajectory.
pub(crate) fn add_ground(world: &mut PhysicsWorld, table: TableKind) {
    let mut block = |half: [f64; 3], centre: [f64; 3], filter: Group| {
        let pose = Isometry3::from(Translation3::from(centre));
        let tag = Tag::new(GROUND, 0, Kind::Fixed);
        let builder = collider(&Primitive::Box { half }, &pose, tag, collision_groups(FIXED, filter));
        world.insert_collider(builder.friction(GROUND_FRICTION), None);
    };
    for sign in [-1.0, 1.0] {
        let [half, z] = [WALL_HEIGHT / 2.0, FLOOR_Z + WALL_HEIGHT / 2.0];
        block([0.05, 1.5, half], [sign * WALL_DISTANCE, 0.0, z], !JOINTED);
        block([1.5, 0.05, half], [0.0, sign * WALL_DISTANCE, z], !JOINTED);
    }
    block([5.0, 5.0, 0.5], [0.0, 0.0, FLOOR_Z - 0.5], !JOINTED);
    let [x, y] = match table {
        TableKind::SingleArmTurned => [1.209, 0.6045],
        TableKind::SingleArm | TableKind::Bimanual => [0.6045, 1.209],
    };
    block([x, y, -FLOOR_Z / 2.0], [-0.12, 0.0, FLOOR_Z / 2.0], !JOINTED);
    if table == TableKind::Bimanual {
        // Hands and fingers reach through this plate, as in the original.
        block([0.6, 0.8, 0.025], [0.0, 0.0, 0.8], !(JOINTED | HAND[0] | HAND[1]));
    }
}

/// Returns the volume in m³.
fn volume(shape: &Primitive) -> f64 {
    use core::f64::consts::PI;
    match *shape {
        Primitive::Box { half } => 8.0 * half.iter().product::<f64>(),
        Primitive::Cylinder { radius, half_height } => 2.0 * PI * radius * radius * half_height,
        Primitive::Ball { radius } => 4.0 / 3.0 * PI * (radius * radius * radius),
        Primitive::Capsule { radius, half_height } => {
            PI * radius * radius * (2.0 * half_height + 4.0 / 3.0 * radius)
        }
        Primitive::Hull { .. } => {
            let (solid, _) = placed_shape(shape, &Isometry3::identity());
            f64::from(solid.mass_properties(1.0).mass())
        }
    }
}
