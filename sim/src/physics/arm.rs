//! One arm as a multibody: built at a pose, driven towards targets, read back.
//!
//! The drives are implicit springs and dampers of the multibody itself; constraint motors slip and joints between free
//! bodies sag. An arm never steps the world it is in.

use ipc_types::ControlMode;
use nalgebra::{Isometry3, Vector3};
use rapier3d::dynamics::{
    JointAxesMask, MassProperties, Multibody, MultibodyIndex, RigidBodyBuilder, RigidBodyHandle,
};
use rapier3d::geometry::{ColliderHandle, NarrowPhase};
use rapier3d::math::Vector;
use rapier3d::pipeline::PhysicsWorld;

use super::convert::{from_pose, from_vector, to_matrix, to_pose, to_vector};
use super::joint::{coordinate, one_freedom};
use super::solids::collider;
use crate::robot::control::{Drive, FINGER_DRIVE, Targets, arm_drive, targets};
use crate::robot::kinematics::Joints;
use crate::robot::panda::{
    FINGER_OPEN, Inertia, LOWER, N_DOFS, N_JOINTS, Solid, UPPER, finger_in_link7, finger_inertia,
    finger_solids, hand_in_link7, joint_origin, link_inertia, link_solids, tcp_in_link7,
};
use crate::scene::{ArmLinks, JointKind, Link, N_LINKS, Robot};

/// Friction of the fingers.
const FINGER_FRICTION: f32 = 2.0;
/// Friction of all other links.
const LINK_FRICTION: f32 = 0.3;
/// Least force on each finger that counts as a grasp, in N.
const GRASP_FORCE_N: f32 = 0.5;
/// Greatest angle between that force and the finger's opening direction: 85°, as its cosine.
const GRASP_COS: f32 = 0.087_155_74;

/// An arm within a rapier world.
pub(super) struct Arm {
    multibody: MultibodyIndex,
    /// Link 0 to 7, then the two fingers.
    links: [RigidBodyHandle; N_DOFS + 1],
    fingers: [Vec<ColliderHandle>; 2],
    drive: Drive,
    targets: Targets,
    /// What each joint moves, as it was at the last command.
    inertia: [f64; N_DOFS],
    hand_in_link7: Isometry3<f32>,
    tcp_in_link7: Isometry3<f32>,
}

impl Arm {
    /// Adds an arm at its drawn pose, fingers open, aiming at where it is.
    pub(super) fn add(
        world: &mut PhysicsWorld,
        robot: &Robot,
        mode: ControlMode,
        wrist_camera: bool,
    ) -> Self {
        let mut builder = Builder { world, links: Vec::with_capacity(N_DOFS + 1) };
        let base = builder.world.insert_body(RigidBodyBuilder::fixed().pose(to_pose(&robot.base)));
        builder.links.push(base);
        builder.add_solids(base, &link_solids(0), LINK_FRICTION);
        for joint in 0..N_JOINTS {
            let axis = Vector3::z();
            let child = builder.add_link(
                builder.links[joint],
                &link_inertia(joint, wrist_camera),
                &joint_origin(joint),
                &axis,
            );
            builder.add_solids(child, &link_solids(joint + 1), LINK_FRICTION);
        }
        let fingers = [1.0, -1.0].map(|side| {
            let axis = Vector3::y() * side;
            let wrist = builder.links[N_JOINTS];
            let finger = builder.add_link(wrist, &finger_inertia(), &finger_in_link7(), &axis);
            builder.add_solids(finger, &finger_solids(side), FINGER_FRICTION)
        });
        let links: [RigidBodyHandle; N_DOFS + 1] =
            builder.links.try_into().unwrap_or_else(|_| unreachable!("a base, seven links and two fingers"));
        let multibody = world.multibody_joints.rigid_body_link(base).expect("the base has joints").multibody;
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
        arm.pose(world);
        arm
    }

    /// Puts the multibody, which rapier builds at position zero, where the targets are.
    fn pose(&self, world: &mut PhysicsWorld) {
        let bodies = &mut world.bodies;
        // rapier would do so in its first step, but the first command already asks for the inertia.
        for link in self.links {
            bodies[link].recompute_mass_properties_from_colliders(&world.colliders);
        }
        let multibody =
            world.multibody_joints.get_multibody_mut(self.multibody).expect("the arm stays in its world");
        multibody.set_self_contacts_enabled(false);
        multibody.forward_kinematics(bodies, true);
        assert_eq!(multibody.ndofs(), N_DOFS, "a fixed base has no freedom of its own");
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

    /// Takes new targets from this arm's part of an action row.
    pub(super) fn command(&mut self, world: &PhysicsWorld, mode: ControlMode, row: &[f32]) {
        let qpos = self.qpos(world);
        self.targets = targets(mode, row, &Joints::from_fn(|joint, _| f64::from(qpos[joint])));
        self.inertia = self.moved_inertia(world);
    }

    /// Sets the springs for the next physics step.
    ///
    /// rapier's springs know no limit of force, so a spring's rest position is drawn in until the force lies within the
    /// drive's. The limit holds for the mean over the step: while a joint gains speed the force of an implicit spring falls,
    /// over one step to about 1 / (1 + x) of its start with x = dt (damping + stiffness · dt) / inertia.
    ///
    /// Returns whether a joint may meet one of its stops within the step.
    pub(super) fn drive(&self, world: &mut PhysicsWorld) -> bool {
        let (qpos, qvel) = (self.qpos(world), self.qvel(world));
        let dt = f64::from(world.integration_parameters.dt);
        let multibody =
            world.multibody_joints.get_multibody_mut(self.multibody).expect("the arm stays in its world");
        let mut meets_any_stop = false;
        for dof in 0..N_DOFS {
            let Drive { stiffness, damping, limit } = self.drive_of(dof);
            let (q, v) = (f64::from(qpos[dof]), f64::from(qvel[dof]));
            let resistance = dt * (damping + stiffness * dt);
            let limit = limit * (1.0 + 0.5 * resistance / self.inertia[dof]);
            let force = (stiffness * (self.target_of(dof) - q) - damping * v).clamp(-limit, limit);
            let rest = q + (force + damping * v) / stiffness;
            let joint = &mut multibody.link_mut(dof + 1).expect("one link per joint").joint;
            joint.set_spring(coordinate(kind(dof)), stiffness as f32, rest as f32);
            // A stop that cannot be met within this step would cost a constraint and do nothing.
            let driven = v + dt * (force - stiffness * dt * v) / (self.inertia[dof] + resistance);
            let [lo, hi] = range(dof);
            let ahead = [q, q + 2.0 * dt * v, q + 2.0 * dt * driven];
            let meets_stop = ahead.iter().any(|q| *q < lo || *q > hi);
            joint.data.limit_axes = if meets_stop { !joint.data.locked_axes } else { JointAxesMask::empty() };
            meets_any_stop |= meets_stop;
        }
        meets_any_stop
    }

    /// Whether the box around a part that moves overlapped the box around anything but the arm itself in the last step.
    pub(super) fn is_near_others(&self, world: &PhysicsWorld) -> bool {
        let is_own = |solid: ColliderHandle| {
            let body = world.colliders[solid].parent();
            body.is_some_and(|body| self.links.contains(&body))
        };
        let moving = self.links[1..].iter().flat_map(|link| world.bodies[*link].colliders());
        moving
            .flat_map(|solid| world.narrow_phase.contact_pairs_with(*solid))
            .any(|pair| !is_own(pair.collider1) || !is_own(pair.collider2))
    }

    /// Inertia that each joint moves, itself and all links beyond it: kg·m², of fingers kg.
    fn moved_inertia(&self, world: &PhysicsWorld) -> [f64; N_DOFS] {
        let multibody = self.multibody(world);
        let mut inertia = [0.0; N_DOFS];
        for (link, handle) in self.links.iter().enumerate().skip(1) {
            let properties = world.bodies[*handle].mass_properties();
            let (mass, turning) = (properties.effective_mass().x, properties.effective_angular_inertia());
            let jacobian = multibody.body_jacobian(link);
            for (dof, inertia) in inertia.iter_mut().enumerate() {
                let column = jacobian.column(dof);
                let linear = Vector::new(column[0], column[1], column[2]);
                let angular = Vector::new(column[3], column[4], column[5]);
                *inertia += f64::from(mass * linear.length_squared() + angular.dot(turning * angular));
            }
        }
        inertia
    }

    /// Positions of joints 1 to 7 (rad) and of the fingers (m).
    pub(super) fn qpos(&self, world: &PhysicsWorld) -> [f32; N_DOFS] {
        let multibody = self.multibody(world);
        core::array::from_fn(|dof| {
            multibody.link(dof + 1).expect("one link per joint").joint().coords()[coordinate(kind(dof))]
        })
    }

    /// Velocities of joints 1 to 7 (rad/s) and of the fingers (m/s).
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

    /// World pose of the TCP.
    pub(super) fn tcp_pose(&self, world: &PhysicsWorld) -> Isometry3<f32> {
        self.link_pose(world, N_JOINTS) * self.tcp_in_link7
    }

    /// World poses of all links.
    pub(super) fn link_poses(&self, world: &PhysicsWorld) -> ArmLinks {
        let mut poses: [Isometry3<f32>; N_LINKS] = core::array::from_fn(|link| match link {
            0..=N_JOINTS => self.link_pose(world, link),
            _ => self.link_pose(world, link - 1),
        });
        poses[Link::Hand as usize] = poses[Link::Link7 as usize] * self.hand_in_link7;
        poses
    }

    /// Whether both fingers press on the body, each within 85° of its opening direction (spec/env.md §3).
    pub(super) fn is_grasping(&self, world: &PhysicsWorld, body: RigidBodyHandle) -> bool {
        [0, 1].into_iter().all(|finger| {
            let opening = self.link_pose(world, N_JOINTS + 1 + finger).rotation * Vector3::y();
            let opening = if finger == 0 { opening } else { -opening };
            let force = self.force_on_finger(world, finger, body);
            let size = force.norm();
            size >= GRASP_FORCE_N && force.dot(&opening) >= GRASP_COS * size
        })
    }

    /// Sum of the normal forces that a body puts on a finger, in N.
    fn force_on_finger(&self, world: &PhysicsWorld, finger: usize, body: RigidBodyHandle) -> Vector3<f32> {
        let phase: &NarrowPhase = &world.narrow_phase;
        let of_body = |other: ColliderHandle| world.colliders[other].parent() == Some(body);
        let mut impulse = Vector3::zeros();
        for &solid in &self.fingers[finger] {
            for pair in phase.contact_pairs_with(solid) {
                // Impulses are those on the second collider of a pair.
                if pair.collider1 == solid && of_body(pair.collider2) {
                    impulse -= from_vector(pair.total_impulse());
                } else if pair.collider2 == solid && of_body(pair.collider1) {
                    impulse += from_vector(pair.total_impulse());
                }
            }
        }
        impulse / world.integration_parameters.dt
    }
}

/// Joints turn, fingers slide.
const fn kind(dof: usize) -> JointKind {
    if dof < N_JOINTS { JointKind::Hinge } else { JointKind::Slide }
}

/// Least and greatest position of a joint or finger.
const fn range(dof: usize) -> [f64; 2] {
    if dof < N_JOINTS { [LOWER[dof], UPPER[dof]] } else { [0.0, FINGER_OPEN] }
}

struct Builder<'a> {
    world: &'a mut PhysicsWorld,
    links: Vec<RigidBodyHandle>,
}

impl Builder<'_> {
    /// Adds the next link, which turns about `axis` (a finger: slides along it) of the frame at `origin` in its parent.
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
        let joint = one_freedom(kind(dof), origin, axis, range(dof));
        self.world.multibody_joints.insert(parent, link, joint, true).expect("links form a tree");
        self.links.push(link);
        link
    }

    fn add_solids(&mut self, link: RigidBodyHandle, solids: &[Solid], friction: f32) -> Vec<ColliderHandle> {
        let add = |(shape, pose): &Solid| {
            self.world.insert_collider(collider(*shape, pose).density(0.0).friction(friction), Some(link))
        };
        solids.iter().map(add).collect()
    }
}
