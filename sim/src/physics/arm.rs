//! One arm as a multibody: construction, joint drives and state readout.
//!
//! The drives are implicit springs and dampers of the multibody itself, because constraint motors slip and
//! joints between free bodies sag. An arm never steps its world.

use ipc_types::ControlMode;
use nalgebra::{Isometry3, Vector3};
use rapier3d::dynamics::{
    JointAxesMask, MassProperties, Multibody, MultibodyIndex, RigidBodyBuilder, RigidBodyHandle,
};
use rapier3d::geometry::{ColliderHandle, NarrowPhase};
use rapier3d::math::Vector;
use rapier3d::pipeline::PhysicsWorld;

use super::bodies::collider;
use super::convert::{from_pose, from_vector, to_matrix, to_pose, to_vector};
use super::joint::{coordinate_idx, single_dof_joint};
use crate::robot::control::{Drive, FINGER_DRIVE, Targets, arm_drive, targets};
use crate::robot::kinematics::Joints;
use crate::robot::panda::{
    CollisionShape, FINGER_OPEN, Inertia, LOWER, N_DOFS, N_JOINTS, UPPER, finger_in_link7, finger_inertia,
    finger_shapes, hand_in_link7, joint_origin, link_inertia, link_shapes, tcp_in_link7,
};
use crate::scene::{ArmLinks, JointKind, Link, N_LINKS, Robot};

/// Friction coefficient of the fingers.
const FINGER_FRICTION: f32 = 2.0;
/// Friction coefficient of all other links.
const LINK_FRICTION: f32 = 0.3;
/// Minimum force on each finger for a grasp, in N.
const MIN_GRASP_FORCE_N: f32 = 0.5;
/// Cosine of the maximum angle, 85°, between that force and the finger's opening direction.
const MIN_GRASP_COS: f32 = 0.087_155_74;

/// Handles and drive state of one arm in a rapier world.
pub(super) struct Arm {
    multibody: MultibodyIndex,
    /// Links 0 to 7, then the two fingers.
    links: [RigidBodyHandle; N_DOFS + 1],
    fingers: [Vec<ColliderHandle>; 2],
    drive: Drive,
    targets: Targets,
    /// Effective inertia of each joint (see [`Self::effective_inertia`]) as of the last command.
    inertia: [f64; N_DOFS],
    hand_in_link7: Isometry3<f32>,
    tcp_in_link7: Isometry3<f32>,
}

impl Arm {
    /// Adds an arm at its start pose with open fingers. Its targets are its start positions.
    pub(super) fn add(
        world: &mut PhysicsWorld,
        robot: &Robot,
        mode: ControlMode,
        wrist_camera: bool,
    ) -> Self {
        let mut builder = ArmBuilder { world, links: Vec::with_capacity(N_DOFS + 1) };
        let base = builder.world.insert_body(RigidBodyBuilder::fixed().pose(to_pose(&robot.base)));
        builder.links.push(base);
        builder.add_shapes(base, &link_shapes(0), LINK_FRICTION);
        for joint in 0..N_JOINTS {
            let axis = Vector3::z();
            let child = builder.add_link(
                builder.links[joint],
                &link_inertia(joint, wrist_camera),
                &joint_origin(joint),
                &axis,
            );
            builder.add_shapes(child, &link_shapes(joint + 1), LINK_FRICTION);
        }
        let fingers = [1.0, -1.0].map(|side| {
            let axis = Vector3::y() * side;
            let wrist = builder.links[N_JOINTS];
            let finger = builder.add_link(wrist, &finger_inertia(), &finger_in_link7(), &axis);
            builder.add_shapes(finger, &finger_shapes(side), FINGER_FRICTION)
        });
        let links: [RigidBodyHandle; N_DOFS + 1] =
            builder.links.try_into().unwrap_or_else(|_| unreachable!("a base, seven links and two fingers"));
        let multibody =
            world.multibody_joints.rigid_body_link(base).expect("the base is part of a multibody").multibody;
        let arm = Self {
            multibody,
            links,
            fingers,
            drive: arm_drive(mode),
            targets: Targets { joints: Joints::from(robot.qpos), finger: FINGER_OPEN },
            inertia: [1.0; N_DOFS],
            hand_in_link7: hand_in_link7().cast(),
            tcp_in_link7: tcp_in_link7().cast(),
        };
        arm.set_start_pose(world);
        arm
    }

    /// Moves the multibody, which rapier creates at joint position zero, to the targets.
    fn set_start_pose(&self, world: &mut PhysicsWorld) {
        let bodies = &mut world.bodies;
        // rapier would do this in its first step, but the first command already needs the inertia.
        for link in self.links {
            bodies[link].recompute_mass_properties_from_colliders(&world.colliders);
        }
        let multibody =
            world.multibody_joints.get_multibody_mut(self.multibody).expect("the arm stays in its world");
        multibody.set_self_contacts_enabled(false);
        multibody.forward_kinematics(bodies, true);
        assert_eq!(multibody.ndofs(), N_DOFS, "a fixed base has no degree of freedom");
        multibody
            .damping_mut()
            .copy_from_slice(&core::array::from_fn::<_, N_DOFS, _>(|dof| self.drive_of(dof).damping as f32));
        multibody
            .apply_displacements(&core::array::from_fn::<_, N_DOFS, _>(|dof| self.target_of(dof) as f32));
        multibody.forward_kinematics(bodies, false);
        multibody.update_rigid_bodies(bodies, true);
    }

    fn drive_of(&self, dof: usize) -> Drive {
        if dof < N_JOINTS { self.drive } else { FINGER_DRIVE }
    }

    fn target_of(&self, dof: usize) -> f64 {
        if dof < N_JOINTS { self.targets.joints[dof] } else { self.targets.finger }
    }

    /// Sets new targets from this arm's part of an action row, [`Targets`] in `mode`.
    pub(super) fn command(&mut self, world: &PhysicsWorld, mode: ControlMode, row: &[f32]) {
        let qpos = self.qpos(world);
        self.targets = targets(mode, row, &Joints::from_fn(|joint, _| f64::from(qpos[joint])));
        self.inertia = self.effective_inertia(world);
    }

    /// Sets the springs for the next physics step. Returns `true` if a joint may reach a joint limit within
    /// the step.
    ///
    /// rapier's springs have no force limit, so the rest position of a spring is moved towards the joint
    /// until the force is within the drive's limit. The limit applies to the mean force over the step: while
    /// a joint accelerates, the force of an implicit spring falls over one step to about 1 / (1 + x) of its
    /// initial value, with x = dt (damping + stiffness · dt) / inertia.
    pub(super) fn drive(&self, world: &mut PhysicsWorld) -> bool {
        let (qpos, qvel) = (self.qpos(world), self.qvel(world));
        let dt = f64::from(world.integration_parameters.dt);
        let multibody =
            world.multibody_joints.get_multibody_mut(self.multibody).expect("the arm stays in its world");
        let mut any_at_limit = false;
        for dof in 0..N_DOFS {
            let Drive { stiffness, damping, limit } = self.drive_of(dof);
            let (q, v) = (f64::from(qpos[dof]), f64::from(qvel[dof]));
            let resistance = dt * (damping + stiffness * dt);
            let limit = limit * (1.0 + 0.5 * resistance / self.inertia[dof]);
            let force = (stiffness * (self.target_of(dof) - q) - damping * v).clamp(-limit, limit);
            let rest = q + (force + damping * v) / stiffness;
            let joint = &mut multibody.link_mut(dof + 1).expect("one link per joint").joint;
            joint.set_spring(coordinate_idx(kind(dof)), stiffness as f32, rest as f32);
            // A limit that the joint cannot reach within this step would add a constraint without effect.
            let predicted_v = v + dt * (force - stiffness * dt * v) / (self.inertia[dof] + resistance);
            let [lo, hi] = range(dof);
            let predicted_q = [q, q + 2.0 * dt * v, q + 2.0 * dt * predicted_v];
            let at_limit = predicted_q.iter().any(|q| *q < lo || *q > hi);
            joint.data.limit_axes = if at_limit { !joint.data.locked_axes } else { JointAxesMask::empty() };
            any_at_limit |= at_limit;
        }
        any_at_limit
    }

    /// Returns `true` if the bounding box of a moving link overlapped that of any collider outside the arm in
    /// the last step.
    pub(super) fn is_near_others(&self, world: &PhysicsWorld) -> bool {
        let is_own = |handle: ColliderHandle| {
            let body = world.colliders[handle].parent();
            body.is_some_and(|body| self.links.contains(&body))
        };
        let moving = self.links[1..].iter().flat_map(|link| world.bodies[*link].colliders());
        moving
            .flat_map(|handle| world.narrow_phase.contact_pairs_with(*handle))
            .any(|pair| !is_own(pair.collider1) || !is_own(pair.collider2))
    }

    /// Returns the inertia that each joint accelerates, i.e. of its own link and all links after it: kg·m²
    /// for arm joints, kg for fingers.
    fn effective_inertia(&self, world: &PhysicsWorld) -> [f64; N_DOFS] {
        let multibody = self.multibody(world);
        let mut inertia = [0.0; N_DOFS];
        for (link, handle) in self.links.iter().enumerate().skip(1) {
            let properties = world.bodies[*handle].mass_properties();
            let (mass, rotational) = (properties.effective_mass().x, properties.effective_angular_inertia());
            let jacobian = multibody.body_jacobian(link);
            for (dof, inertia) in inertia.iter_mut().enumerate() {
                let column = jacobian.column(dof);
                let linear = Vector::new(column[0], column[1], column[2]);
                let angular = Vector::new(column[3], column[4], column[5]);
                *inertia += f64::from(mass * linear.length_squared() + angular.dot(rotational * angular));
            }
        }
        inertia
    }

    /// Returns the positions of joints 1 to 7 (rad) and of the fingers (m).
    pub(super) fn qpos(&self, world: &PhysicsWorld) -> [f32; N_DOFS] {
        let multibody = self.multibody(world);
        core::array::from_fn(|dof| {
            multibody.link(dof + 1).expect("one link per joint").joint().coords()[coordinate_idx(kind(dof))]
        })
    }

    /// Returns the velocities of joints 1 to 7 (rad/s) and of the fingers (m/s).
    pub(super) fn qvel(&self, world: &PhysicsWorld) -> [f32; N_DOFS] {
        let velocity = self.multibody(world).generalized_velocity();
        core::array::from_fn(|dof| velocity[dof])
    }

    fn multibody<'a>(&self, world: &'a PhysicsWorld) -> &'a Multibody {
        world.multibody_joints.get_multibody(self.multibody).expect("the arm stays in its world")
    }

    fn link_pose(&self, world: &PhysicsWorld, link: usize) -> Isometry3<f32> {
        from_pose(world.bodies[self.links[link]].position())
    }

    /// Returns the TCP pose in the world frame.
    pub(super) fn tcp_pose(&self, world: &PhysicsWorld) -> Isometry3<f32> {
        self.link_pose(world, N_JOINTS) * self.tcp_in_link7
    }

    /// Returns the poses of all links in the world frame.
    pub(super) fn link_poses(&self, world: &PhysicsWorld) -> ArmLinks {
        let mut poses: [Isometry3<f32>; N_LINKS] = core::array::from_fn(|link| match link {
            0..=N_JOINTS => self.link_pose(world, link),
            _ => self.link_pose(world, link - 1),
        });
        poses[Link::Hand as usize] = poses[Link::Link7 as usize] * self.hand_in_link7;
        poses
    }

    /// Returns `true` if both fingers press on the body with at least 0.5 N, each within 85° of its opening
    /// direction.
    pub(super) fn is_grasping(&self, world: &PhysicsWorld, body: RigidBodyHandle) -> bool {
        [0, 1].into_iter().all(|finger| {
            let opening = self.link_pose(world, N_JOINTS + 1 + finger).rotation * Vector3::y();
            let opening = if finger == 0 { opening } else { -opening };
            let force = self.force_on_finger(world, finger, body);
            let size = force.norm();
            size >= MIN_GRASP_FORCE_N && force.dot(&opening) >= MIN_GRASP_COS * size
        })
    }

    /// Returns the sum of the normal forces that a body exerts on a finger, in N.
    fn force_on_finger(&self, world: &PhysicsWorld, finger: usize, body: RigidBodyHandle) -> Vector3<f32> {
        let phase: &NarrowPhase = &world.narrow_phase;
        let is_of_body = |other: ColliderHandle| world.colliders[other].parent() == Some(body);
        let mut impulse = Vector3::zeros();
        for &handle in &self.fingers[finger] {
            for pair in phase.contact_pairs_with(handle) {
                // rapier reports the impulse on the second collider of a pair.
                if pair.collider1 == handle && is_of_body(pair.collider2) {
                    impulse -= from_vector(pair.total_impulse());
                } else if pair.collider2 == handle && is_of_body(pair.collider1) {
                    impulse += from_vector(pair.total_impulse());
                }
            }
        }
        impulse / world.integration_parameters.dt
    }
}

/// Returns the joint type of a degree of freedom: arm joints are revolute, fingers prismatic.
const fn kind(dof: usize) -> JointKind {
    if dof < N_JOINTS { JointKind::Hinge } else { JointKind::Slide }
}

/// Returns the minimum and maximum position of a joint (rad) or finger (m).
const fn range(dof: usize) -> [f64; 2] {
    if dof < N_JOINTS { [LOWER[dof], UPPER[dof]] } else { [0.0, FINGER_OPEN] }
}

/// Inserts links into a world and records their handles.
struct ArmBuilder<'a> {
    world: &'a mut PhysicsWorld,
    links: Vec<RigidBodyHandle>,
}

impl ArmBuilder<'_> {
    /// Adds the next link. Its joint has the frame `origin` in the parent and rotates about `axis` of that
    /// frame; a finger slides along it.
    fn add_link(
        &mut self,
        parent: RigidBodyHandle,
        inertia: &Inertia,
        origin: &Isometry3<f64>,
        axis: &Vector3<f64>,
    ) -> RigidBodyHandle {
        let mass = MassProperties::with_inertia_matrix(
            to_vector(&inertia.com),
            inertia.mass as f32,
            to_matrix(&inertia.matrix),
        );
        let link =
            RigidBodyBuilder::dynamic().gravity_scale(0.0).can_sleep(false).additional_mass_properties(mass);
        let link = self.world.insert_body(link);
        let dof = self.links.len() - 1;
        let joint = single_dof_joint(kind(dof), origin, axis, range(dof));
        self.world.multibody_joints.insert(parent, link, joint, true).expect("the links form a tree");
        self.links.push(link);
        link
    }

    fn add_shapes(
        &mut self,
        link: RigidBodyHandle,
        shapes: &[CollisionShape],
        friction: f32,
    ) -> Vec<ColliderHandle> {
        let add = |(shape, pose): &CollisionShape| {
            self.world.insert_collider(collider(shape, pose).density(0.0).friction(friction), Some(link))
        };
        shapes.iter().map(add).collect()
    }
}
