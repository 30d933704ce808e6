//! The bodies of a scene other than the arms, and the table and floor.

use nalgebra::{Isometry3, Translation3};
use rapier3d::dynamics::{MassProperties, RigidBodyBuilder, RigidBodyHandle};
use rapier3d::geometry::{ColliderBuilder, Group, InteractionGroups, InteractionTestMode, SharedShape};
use rapier3d::math::{Rotation, Vector};
use rapier3d::pipeline::PhysicsWorld;

use super::BodyState;
use super::convert::{from_pose, from_vector, to_pose, to_vector};
use super::hull::Hull;
use super::joint::{coordinate_idx, single_dof_joint};
use scene::{Body, JointKind, JointSpec, Mass, Motion, Primitive, TableKind};

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
/// Collision groups of the arms' links, and of their hands and fingers.
pub(crate) const LINK: Group = Group::GROUP_3;
pub(crate) const HAND: Group = Group::GROUP_4;

/// Builds a collider of a shape at a pose in its parent's frame.
pub(crate) fn collider(shape: &Primitive, pose: &Isometry3<f64>) -> ColliderBuilder {
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
    ColliderBuilder::new(shape).position(position)
}

/// Adds a body at its start pose, with its colliders and its joint.
pub(crate) fn add_body(world: &mut PhysicsWorld, body: &Body) -> RigidBodyHandle {
    let (builder, groups) = match body.motion {
        Motion::Dynamic => (RigidBodyBuilder::dynamic(), InteractionGroups::all()),
        Motion::Jointed(_) => (RigidBodyBuilder::dynamic(), collision_groups(JOINTED, !(FIXED | JOINTED))),
        Motion::Fixed | Motion::VisualOnly => (RigidBodyBuilder::fixed(), collision_groups(FIXED, !JOINTED)),
    };
    let [linear, angular] = body.damping.map(|damping| damping as f32);
    let mut builder = builder.linear_damping(linear).angular_damping(angular);
    if let Mass::Measured { kg, centre, inertia } = body.mass {
        builder = builder.additional_mass_properties(mass_properties(kg, centre, inertia));
    }
    let handle = world.insert_body(builder.pose(to_pose(&body.pose)));
    if body.motion == Motion::VisualOnly {
        return handle;
    }
    let density = match body.mass {
        Mass::Density(density) => {
            let mass: f64 = body.parts.iter().map(|part| volume(&part.shape) * density).sum();
            density * (MIN_MASS_KG / mass).max(1.0)
        }
        Mass::Measured { .. } => 0.0,
    };
    for part in &body.parts {
        let collider_builder =
            collider(&part.shape, &part.pose).density(density as f32).friction(body.friction as f32);
        world.insert_collider(collider_builder.collision_groups(groups), Some(handle));
    }
    if let Motion::Jointed(joint) = body.motion {
        attach(world, handle, &joint, &body.pose);
    }
    handle
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

/// Attaches a body to its start pose by a multibody with one joint, because joints between free bodies sag.
fn attach(world: &mut PhysicsWorld, body: RigidBodyHandle, joint: &JointSpec, start: &Isometry3<f64>) {
    let anchor = world.insert_body(RigidBodyBuilder::fixed().pose(to_pose(start)));
    let guide =
        single_dof_joint(joint.kind, &Isometry3::identity(), &joint.axis.into(), Some([0.0, joint.upper]));
    world.multibody_joints.insert(anchor, body, guide, true).expect("an anchor and a body form a tree");
    let link = *world.multibody_joints.rigid_body_link(body).expect("the body was just attached");
    let bodies = &mut world.bodies;
    bodies[body].recompute_mass_properties_from_colliders(&world.colliders);
    let multibody =
        world.multibody_joints.get_multibody_mut(link.multibody).expect("the body was just attached");
    multibody.forward_kinematics(bodies, true);
    assert_eq!(multibody.ndofs(), 1, "an anchor has no degree of freedom");
    multibody.damping_mut()[0] = joint.damping as f32;
    multibody.frictions_mut()[0] = joint.friction as f32;
    multibody.forward_kinematics(bodies, false);
    multibody.update_rigid_bodies(bodies, true);
}

/// Returns the joint position of a jointed body, in m or rad.
pub(crate) fn joint_position(world: &PhysicsWorld, body: RigidBodyHandle, kind: JointKind) -> f32 {
    let link = *world.multibody_joints.rigid_body_link(body).expect("a jointed body is in a multibody");
    let multibody = world.multibody_joints.get_multibody(link.multibody).expect("a link's multibody exists");
    multibody.link(link.id).expect("a link of its multibody").joint().coords()[coordinate_idx(kind)]
}

/// Sets pose and velocity of a body without a joint.
pub(crate) fn set_state(world: &mut PhysicsWorld, body: RigidBodyHandle, state: &BodyState) {
    let body = &mut world.bodies[body];
    body.set_position(to_pose(&state.pose.cast()), true);
    if body.is_dynamic() {
        body.set_linvel(to_vector(&state.linear_velocity.cast()), true);
        body.set_angvel(to_vector(&state.angular_velocity.cast()), true);
    }
}

/// Moves a body on a joint to the position nearest to a pose, and sets its velocity along the joint.
pub(crate) fn set_joint_state(
    world: &mut PhysicsWorld,
    body: RigidBodyHandle,
    kind: JointKind,
    state: &BodyState,
) {
    let link = *world.multibody_joints.rigid_body_link(body).expect("a jointed body is in a multibody");
    let now = from_pose(world.bodies[body].position());
    let multibody =
        world.multibody_joints.get_multibody_mut(link.multibody).expect("a link's multibody exists");
    let joint = &multibody.link(link.id).expect("a link of its multibody").joint().data;
    let axis = from_vector(joint.local_frame2.rotation * Vector::X);
    let (displacement, velocity) = match kind {
        JointKind::Slide => {
            let axis = now.rotation * axis;
            let moved = state.pose.translation.vector - now.translation.vector;
            (moved.dot(&axis), state.linear_velocity.dot(&axis))
        }
        JointKind::Hinge => {
            let turned = (now.rotation.inverse() * state.pose.rotation).into_inner();
            let angle = 2.0 * libm::atan2f(turned.imag().dot(&axis), turned.w);
            let turn = core::f32::consts::TAU;
            (angle - turn * libm::roundf(angle / turn), state.angular_velocity.dot(&(now.rotation * axis)))
        }
    };
    multibody.apply_displacements(&[displacement]);
    multibody.generalized_velocity_mut()[0] = velocity;
    let bodies = &mut world.bodies;
    multibody.forward_kinematics(bodies, false);
    multibody.update_rigid_bodies(bodies, true);
}

/// Adds the floor, the table and the four walls of the room (docs/benchmark.md, "Scenes and objects").
///
/// The walls exist even where no background perturbation shows them: appearance never affects a trajectory.
pub(crate) fn add_ground(world: &mut PhysicsWorld, table: TableKind) {
    let mut block = |half: [f64; 3], centre: [f64; 3], filter: Group| {
        let pose = Isometry3::from(Translation3::from(centre));
        let collider_builder = collider(&Primitive::Box { half }, &pose).friction(GROUND_FRICTION);
        world.insert_collider(collider_builder.collision_groups(collision_groups(FIXED, filter)), None);
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
        block([0.6, 0.8, 0.025], [0.0, 0.0, 0.8], !(JOINTED | HAND));
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
            let solid = collider(shape, &Isometry3::identity()).build();
            f64::from(solid.shape().mass_properties(1.0).mass())
        }
    }
}
