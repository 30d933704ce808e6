//! One arm as a multibody: construction, joint drives and state readout.
//!
//! The drives are implicit springs and dampers of the multibody itself, because constraint motors slip and
//! joints between free bodies sag. An arm never steps its world.

use ipc_types::ControlMode;
use nalgebra::{Isometry3, Vector3};
use rapier3d::dynamics::{
    MassProperties, Multibody, MultibodyDofCoupling, MultibodyIndex, MultibodyJointSet, RigidBodyBuilder,
    RigidBodyHandle,
};
use rapier3d::geometry::{ColliderHandle, Group, InteractionGroups, NarrowPhase};
use rapier3d::pipeline::{ActiveHooks, PhysicsWorld};

use super::bodies::{HAND, LINK, collider, collision_groups};
use super::convert::{from_pose, from_vector, to_matrix, to_pose, to_vector};
use super::hooks::{ARM_PREDICTION_M, FINGER};
use super::joint::{axis, coordinate_idx, single_dof_joint};
use super::{ArmState, Parameters};
use crate::robot::control::{Drive, FINGER_DRIVE, Targets, arm_drive, targets};
use crate::robot::dynamics::{self, JointMatrix, LinkInertias};
use scene::robot::kinematics::Joints;
use scene::robot::panda::{
    CollisionShape, FINGER_OPEN, Inertia, LOWER, N_DOFS, N_JOINTS, UPPER, finger_in_link7, finger_inertia,
    finger_shapes, hand_in_link7, hand_shapes, joint_origin, link_inertia, link_shapes, tcp_in_link7,
};
use scene::{ArmLinks, JointKind, Link, N_LINKS, Robot};

/// Friction coefficient of links and hand.
const LINK_FRICTION: f32 = 0.3;
/// Collision groups of the links, and of hand and fingers.
const LINK_GROUPS: InteractionGroups = collision_groups(LINK, Group::ALL);
const HAND_GROUPS: InteractionGroups = collision_groups(HAND, Group::ALL);
/// Makes both fingers move alike, as in the original.
const FINGER_COUPLING: MultibodyDofCoupling = MultibodyDofCoupling {
    link1: N_JOINTS + 1,
    dof1: 0,
    axis1: 0,
    link2: N_JOINTS + 2,
    dof2: 0,
    axis2: 0,
    coeff: 1.0,
    offset: 0.0,
};
/// Maximum speed of a joint after a physics step, in rad/s or m/s: the default of PhysX.
const MAX_JOINT_SPEED: f32 = 100.0;
/// Distance from a joint limit within which the limit is part of the solver's problem, in rad and m: farther
/// than a joint moves in a physics step.
const NEAR_LIMIT: [f64; 2] = [0.1, 0.01];
/// Distance inside a joint limit at which rapier's constraint begins to act, in rad or m. A joint that is
/// exactly at its limit must be held there.
const LIMIT_MARGIN: f64 = 1e-6;
/// Minimum force on each finger for a grasp, in N.
const MIN_GRASP_FORCE_N: f32 = 0.5;
/// Cosine of the maximum angle, 85°, between that force and the finger's opening direction.
const MIN_GRASP_COS: f32 = 0.087_155_74;

/// Handles and drive state of one arm in a rapier world.
pub(crate) struct Arm {
    multibody: MultibodyIndex,
    /// Links 0 to 7, then the two fingers.
    links: [RigidBodyHandle; N_DOFS + 1],
    fingers: [Vec<ColliderHandle>; 2],
    drive: Drive,
    targets: Targets,
    inertias: LinkInertias,
    /// The next physics step if the arm touches nothing.
    prediction: Prediction,
    /// Added to the joint velocities after a physics step.
    velocity_correction: Joints,
    hand_in_link7: Isometry3<f32>,
    tcp_in_link7: Isometry3<f32>,
}

impl Arm {
    /// Adds an arm at its start pose with open fingers. Its targets are its start positions.
    pub(crate) fn add(
        world: &mut PhysicsWorld,
        robot: &Robot,
        mode: ControlMode,
        parameters: &Parameters,
    ) -> Self {
        let mut builder = ArmBuilder { world, links: Vec::with_capacity(N_DOFS + 1) };
        let base = builder.world.insert_body(RigidBodyBuilder::fixed().pose(to_pose(&robot.base)));
        builder.links.push(base);
        builder.add_shapes(base, &link_shapes(0), LINK_FRICTION, LINK_GROUPS);
        for joint in 0..N_JOINTS {
            let axis = Vector3::z();
            let child =
                builder.add_link(builder.links[joint], &link_inertia(joint), &joint_origin(joint), &axis);
            builder.add_shapes(child, &link_shapes(joint + 1), LINK_FRICTION, LINK_GROUPS);
        }
        let wrist = builder.links[N_JOINTS];
        builder.add_shapes(wrist, &hand_shapes(), LINK_FRICTION, HAND_GROUPS);
        let fingers = [1.0, -1.0].map(|side| {
            let axis = Vector3::y() * side;
            let finger = builder.add_link(wrist, &finger_inertia(), &finger_in_link7(), &axis);
            let handles =
                builder.add_shapes(finger, &finger_shapes(side), parameters.finger_friction, HAND_GROUPS);
            for handle in &handles {
                builder.world.colliders[*handle].user_data = FINGER;
            }
            handles
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
            inertias: LinkInertias::default(),
            prediction: Prediction::default(),
            velocity_correction: Joints::zeros(),
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
        let multibody = multibody_mut(&mut world.multibody_joints, self.multibody);
        multibody.set_self_contacts_enabled(false);
        multibody.add_dof_coupling(FINGER_COUPLING);
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

    /// Sets positions and velocities of all joints. The targets become the positions.
    pub(crate) fn set_state(&mut self, world: &mut PhysicsWorld, state: &ArmState) {
        let now = self.qpos(world);
        let bodies = &mut world.bodies;
        let multibody = multibody_mut(&mut world.multibody_joints, self.multibody);
        multibody
            .apply_displacements(&core::array::from_fn::<_, N_DOFS, _>(|dof| state.qpos[dof] - now[dof]));
        multibody.generalized_velocity_mut().copy_from_slice(&state.qvel);
        multibody.forward_kinematics(bodies, false);
        multibody.update_rigid_bodies(bodies, true);
        self.targets = Targets {
            joints: Joints::from_fn(|joint, _| f64::from(state.qpos[joint])),
            finger: f64::from(state.qpos[N_JOINTS]),
        };
    }

    /// Makes the limits of the joints that are near theirs part of the next physics step, or those of none.
    pub(crate) fn limit_joints(&self, world: &mut PhysicsWorld, limits_matter: bool) {
        let qpos = self.qpos(world);
        let multibody = multibody_mut(&mut world.multibody_joints, self.multibody);
        for (dof, q) in qpos.into_iter().map(f64::from).enumerate() {
            let [min, max] = limits_of(dof);
            let near = NEAR_LIMIT[usize::from(dof >= N_JOINTS)];
            let joint = &mut multibody.link_mut(dof + 1).expect("one link per joint").joint.data;
            let axis = axis(kind(dof));
            if limits_matter && (q < min + near || q > max - near) {
                joint.set_limits(axis, [(min + LIMIT_MARGIN) as f32, (max - LIMIT_MARGIN) as f32]);
            } else {
                joint.limit_axes.remove(axis.into());
            }
        }
    }

    fn drive_of(&self, dof: usize) -> Drive {
        if dof < N_JOINTS { self.drive } else { FINGER_DRIVE }
    }

    fn target_of(&self, dof: usize) -> f64 {
        if dof < N_JOINTS { self.targets.joints[dof] } else { self.targets.finger }
    }

    /// Sets new targets from this arm's part of an action row, [`Targets`] in `mode`.
    pub(crate) fn command(&mut self, world: &PhysicsWorld, mode: ControlMode, row: &[f32]) {
        let qpos = self.qpos(world);
        self.targets = targets(mode, row, &Joints::from_fn(|joint, _| f64::from(qpos[joint])));
    }

    /// Predicts the next physics step for the case that the arm touches nothing.
    pub(crate) fn predict(&mut self, world: &PhysicsWorld) {
        let (qpos, qvel) = (self.qpos(world).map(f64::from), self.qvel(world).map(f64::from));
        let dt = f64::from(world.integration_parameters.dt);
        let start =
            [Joints::from_column_slice(&qpos[..N_JOINTS]), Joints::from_column_slice(&qvel[..N_JOINTS])];
        let inertia = self.inertias.matrix(&start[0]);
        // The matrix is positive definite unless the simulation has diverged, which ends the episode.
        let Some(inverse) = inertia.cholesky().map(|factor| factor.inverse()) else { return };
        let [mut q, mut v] = start;
        dynamics::advance(&mut q, &mut v, &self.targets.joints, self.drive, &inverse, dt);
        let fingers = [N_JOINTS, N_JOINTS + 1].map(|dof| {
            let (mut q, mut v) = (qpos[dof], qvel[dof]);
            dynamics::advance_finger(&mut q, &mut v, self.targets.finger, FINGER_DRIVE, dt);
            (qpos[dof], qvel[dof], q)
        });
        self.prediction = Prediction { start, end: [q, v], inertia, fingers };
    }

    /// Sets the springs for the next physics step of `n_substeps` implicit substeps.
    ///
    /// rapier's springs and dampers are implicit, so that they yield to contacts as the drives do, but one or
    /// two implicit substeps move the arm less than the drives would. The rest positions of the springs are
    /// chosen such that an arm that touches nothing moves exactly as predicted. With the inertia matrix M,
    /// substep h, stiffness k and damping d, a substep maps the velocity v to A⁻¹ (M v + h k (rest − q)),
    /// where A = M + h d + h² k. All these matrices commute.
    pub(crate) fn drive(&mut self, world: &mut PhysicsWorld, n_substeps: usize) {
        let dt = f64::from(world.integration_parameters.dt);
        let h = dt / n_substeps as f64;
        let Prediction { start: [q, v], end: [q_end, v_end], inertia, fingers } = &self.prediction;
        let Drive { stiffness: k, damping: d, .. } = self.drive;
        let shifted = |factor: f64, shift: f64| inertia * factor + JointMatrix::identity() * shift;
        let mean = (q_end - q) / h;
        let a = shifted(1.0, h * d + h * h * k);
        let (rest, last_v) = if n_substeps == 1 {
            (q + (a * mean - inertia * v) / (h * k), mean)
        } else {
            let c = shifted(2.0, h * d);
            let sum = shifted(3.0, 2.0 * h * d + h * h * k);
            let solve = |matrix: JointMatrix, rhs: Joints| {
                matrix
                    .cholesky()
                    .expect("a sum of positive definite matrices is positive definite")
                    .solve(&rhs)
            };
            let pull = solve(sum, a * (a * mean) - c * (inertia * v));
            (q + pull / (h * k), mean - solve(a, inertia * v + pull))
        };
        self.velocity_correction = v_end - last_v;
        let finger_mass = finger_inertia().mass;
        let finger_rest = fingers.map(|(q, v, end)| {
            let Drive { stiffness: k, damping: d, .. } = FINGER_DRIVE;
            let (mean, a) = ((end - q) / h, finger_mass + h * d + h * h * k);
            let pull = if n_substeps == 1 {
                a * mean - finger_mass * v
            } else {
                let c = 2.0 * finger_mass + h * d;
                (a * a * mean - c * finger_mass * v) / (c + a)
            };
            q + pull / (h * k)
        });
        let multibody = multibody_mut(&mut world.multibody_joints, self.multibody);
        for dof in 0..N_DOFS {
            let stiffness = if dof < N_JOINTS { k } else { FINGER_DRIVE.stiffness };
            let rest = if dof < N_JOINTS { rest[dof] } else { finger_rest[dof - N_JOINTS] };
            let joint = &mut multibody.link_mut(dof + 1).expect("one link per joint").joint;
            joint.set_spring(coordinate_idx(kind(dof)), stiffness as f32, rest as f32);
        }
    }

    /// Completes a physics step. The implicit substeps end at their mean velocity, the drives at another one.
    /// No joint stays faster than [`MAX_JOINT_SPEED`]: rapier integrates Coriolis forces explicitly, which
    /// diverges from there on. No joint stays beyond its limit: what rapier's iterations leave of a
    /// violation, and a step in which a contact pushes a joint into its limit, is corrected here.
    pub(crate) fn finish_step(&self, world: &mut PhysicsWorld) {
        let qpos = self.qpos(world);
        let multibody = multibody_mut(&mut world.multibody_joints, self.multibody);
        let mut velocity = multibody.generalized_velocity_mut();
        let mut excess = [0.0; N_DOFS];
        for dof in 0..N_DOFS {
            let correction = if dof < N_JOINTS { self.velocity_correction[dof] as f32 } else { 0.0 };
            let [min, max] = limits_of(dof).map(|limit| limit as f32);
            excess[dof] = qpos[dof].clamp(min, max) - qpos[dof];
            let [lowest, highest] =
                [excess[dof] <= 0.0, excess[dof] >= 0.0].map(|may| f32::from(u8::from(may)));
            velocity[dof] =
                (velocity[dof] + correction).clamp(-MAX_JOINT_SPEED * lowest, MAX_JOINT_SPEED * highest);
        }
        if excess.iter().any(|excess| excess.abs() > LIMIT_MARGIN as f32) {
            multibody.apply_displacements(&excess);
            multibody.forward_kinematics(&world.bodies, false);
            multibody.update_rigid_bodies(&mut world.bodies, true);
        }
    }

    /// Returns `true` if a moving link was about to touch anything outside the arm in the last step.
    pub(crate) fn is_near_others(&self, world: &PhysicsWorld) -> bool {
        let is_own = |handle: ColliderHandle| {
            let body = world.colliders[handle].parent();
            body.is_some_and(|body| self.links.contains(&body))
        };
        let moving = self.links[1..].iter().flat_map(|link| world.bodies[*link].colliders());
        moving.flat_map(|handle| world.narrow_phase.contact_pairs_with(*handle)).any(|pair| {
            let nearest = || pair.find_deepest_contact().map(|(_, contact)| contact.dist);
            !(is_own(pair.collider1) && is_own(pair.collider2))
                && nearest().is_some_and(|distance| distance < ARM_PREDICTION_M)
        })
    }

    /// Returns the positions of joints 1 to 7 (rad) and of the fingers (m).
    pub(crate) fn qpos(&self, world: &PhysicsWorld) -> [f32; N_DOFS] {
        let multibody = self.multibody(world);
        core::array::from_fn(|dof| {
            multibody.link(dof + 1).expect("one link per joint").joint().coords()[coordinate_idx(kind(dof))]
        })
    }

    /// Returns the velocities of joints 1 to 7 (rad/s) and of the fingers (m/s).
    pub(crate) fn qvel(&self, world: &PhysicsWorld) -> [f32; N_DOFS] {
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
    pub(crate) fn tcp_pose(&self, world: &PhysicsWorld) -> Isometry3<f32> {
        self.link_pose(world, N_JOINTS) * self.tcp_in_link7
    }

    /// Returns the poses of all links in the world frame.
    pub(crate) fn link_poses(&self, world: &PhysicsWorld) -> ArmLinks {
        let mut poses: [Isometry3<f32>; N_LINKS] = core::array::from_fn(|link| match link {
            0..=N_JOINTS => self.link_pose(world, link),
            _ => self.link_pose(world, link - 1),
        });
        poses[Link::Hand as usize] = poses[Link::Link7 as usize] * self.hand_in_link7;
        poses
    }

    /// Returns `true` if both fingers press on the body with at least 0.5 N, each within 85° of its opening
    /// direction.
    pub(crate) fn is_grasping(&self, world: &PhysicsWorld, body: RigidBodyHandle) -> bool {
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

/// A physics step of an arm that touches nothing.
#[derive(Default)]
struct Prediction {
    /// Joint positions (rad) and velocities (rad/s) before the step.
    start: [Joints; 2],
    /// Joint positions and velocities after the step.
    end: [Joints; 2],
    /// Inertia matrix, in kg·m².
    inertia: JointMatrix,
    /// Position (m) and velocity (m/s) of each finger before the step, and its position after it.
    fingers: [(f64, f64, f64); 2],
}

/// Returns the minimum and maximum position of a joint, in rad or m.
const fn limits_of(dof: usize) -> [f64; 2] {
    if dof < N_JOINTS { [LOWER[dof], UPPER[dof]] } else { [0.0, FINGER_OPEN] }
}

fn multibody_mut(joints: &mut MultibodyJointSet, index: MultibodyIndex) -> &mut Multibody {
    joints.get_multibody_mut(index).expect("the arm stays in its world")
}

/// Returns the joint type of a degree of freedom: arm joints are revolute, fingers prismatic.
const fn kind(dof: usize) -> JointKind {
    if dof < N_JOINTS { JointKind::Hinge } else { JointKind::Slide }
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
        let joint = single_dof_joint(kind(dof), origin, axis, None);
        self.world.multibody_joints.insert(parent, link, joint, true).expect("the links form a tree");
        self.links.push(link);
        link
    }

    fn add_shapes(
        &mut self,
        link: RigidBodyHandle,
        shapes: &[CollisionShape],
        friction: f32,
        groups: InteractionGroups,
    ) -> Vec<ColliderHandle> {
        let add = |(shape, pose): &CollisionShape| {
            let collider = collider(shape, pose).density(0.0).friction(friction).collision_groups(groups);
            let hooks = ActiveHooks::MODIFY_SOLVER_CONTACTS;
            self.world.insert_collider(collider.active_hooks(hooks), Some(link))
        };
        shapes.iter().map(add).collect()
    }
}
