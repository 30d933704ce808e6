//! The physics world of one environment.

use ipc_types::ControlMode;
use nalgebra::{Isometry3, Vector3};
use rapier3d::dynamics::RigidBodyHandle;
use rapier3d::math::Vector;
use rapier3d::pipeline::PhysicsWorld;

use super::arm::Arm;
use super::convert::{from_pose, from_vector};
use super::hooks::ArmContacts;
use super::{ArmState, BodyState, Parameters, WorldState, bodies};
use crate::physics::fingerprint::Fingerprint;
use scene::robot::panda::{N_DOFS, N_JOINTS};
use scene::{JointKind, Motion, Scene, Snapshot};

/// Control steps per second of simulated time.
pub const CONTROL_HZ: f64 = 20.0;
/// Gravitational acceleration along world z, in m/s².
const GRAVITY: f32 = -9.81;

/// The bodies and arms of one scene, driven in one control mode.
pub struct World {
    rapier: PhysicsWorld,
    arms: Vec<Arm>,
    bodies: Vec<RigidBodyHandle>,
    joints: Vec<Option<JointKind>>,
    mode: ControlMode,
    parameters: Parameters,
    /// Physics steps per control step.
    steps_per_control: u32,
}

impl World {
    /// Builds the world of a scene in its start state. The arms' targets are their start positions.
    #[must_use]
    pub fn build(scene: &Scene, mode: ControlMode) -> Self {
        Self::with_parameters(scene, mode, &Parameters::default())
    }

    /// Builds the world as [`Self::build`] does, with other parameters than the default.
    ///
    /// # Panics
    /// If the number of substeps is neither 1 nor 2.
    #[must_use]
    pub fn with_parameters(scene: &Scene, mode: ControlMode, parameters: &Parameters) -> Self {
        assert!(matches!(parameters.substeps, 1 | 2), "a physics step has one or two substeps");
        let mut rapier = PhysicsWorld {
            gravity: Vector::new(0.0, 0.0, GRAVITY),
            integration_parameters: parameters.integration(scene.physics_hz),
            ..PhysicsWorld::default()
        };
        bodies::add_ground(&mut rapier, scene.table.kind);
        let bodies = scene.bodies.iter().map(|body| bodies::add_body(&mut rapier, body)).collect();
        let arms = scene.robots.iter().map(|robot| Arm::add(&mut rapier, robot, mode, parameters)).collect();
        let joints = scene.bodies.iter().map(|body| match body.motion {
            Motion::Jointed(joint) => Some(joint.kind),
            Motion::Dynamic | Motion::Fixed | Motion::VisualOnly => None,
        });
        Self {
            rapier,
            arms,
            bodies,
            joints: joints.collect(),
            mode,
            parameters: parameters.clone(),
            steps_per_control: scene.physics_hz / CONTROL_HZ as u32,
        }
    }

    /// Returns the current state.
    #[must_use]
    pub fn state(&self) -> WorldState {
        let arm = |arm| ArmState { qpos: self.qpos(arm), qvel: self.qvel(arm) };
        let body = |body| {
            let (linear_velocity, angular_velocity) = self.body_velocity(body);
            BodyState { pose: self.body_pose(body), linear_velocity, angular_velocity }
        };
        WorldState {
            arms: (0..self.n_arms()).map(arm).collect(),
            bodies: (0..self.n_bodies()).map(body).collect(),
        }
    }

    /// Sets the state. The targets of the arms become their positions. A body on a joint is moved along the
    /// joint to the position nearest to its pose, and only the part of its velocity along the joint counts.
    ///
    /// # Panics
    /// If the state has another number of arms or bodies.
    pub fn set_state(&mut self, state: &WorldState) {
        let n = (state.arms.len(), state.bodies.len());
        assert_eq!(n, (self.arms.len(), self.bodies.len()), "the state belongs to another scene");
        for (arm, state) in self.arms.iter_mut().zip(&state.arms) {
            arm.set_state(&mut self.rapier, state);
        }
        for ((&body, joint), state) in self.bodies.iter().zip(&self.joints).zip(&state.bodies) {
            match *joint {
                Some(kind) => bodies::set_joint_state(&mut self.rapier, body, kind, state),
                None => bodies::set_state(&mut self.rapier, body, state),
            }
        }
    }

    /// Executes one control step of 0.05 s. `action` is one row, `[action_dim]` f32: the parts of all arms,
    /// one after another.
    ///
    /// # Panics
    /// If the row has another length.
    pub fn step(&mut self, action: &[f32]) {
        self.command(action);
        for _ in 0..self.steps_per_control {
            self.drive();
            let dt = self.rapier.integration_parameters.dt;
            self.rapier.step_with_events(&ArmContacts { parameters: &self.parameters, dt }, &());
            for arm in &self.arms {
                arm.finish_step(&mut self.rapier);
            }
        }
    }

    /// Sets the arms' new targets.
    fn command(&mut self, action: &[f32]) {
        let width = match self.mode {
            ControlMode::EeDeltaPose | ControlMode::EePose => N_JOINTS,
            ControlMode::JointPos => N_JOINTS + 1,
        };
        assert_eq!(action.len(), width * self.arms.len(), "an action row holds one part per arm");
        for (arm, row) in self.arms.iter_mut().zip(action.chunks_exact(width)) {
            arm.command(&self.rapier, self.mode, row);
        }
    }

    /// Sets the arms' springs and the number of solver substeps for the next physics step.
    fn drive(&mut self) {
        for arm in &mut self.arms {
            arm.predict(&self.rapier);
        }
        let needs_substeps = self.arms.iter().any(|arm| arm.is_near_others(&self.rapier));
        let n_substeps = if needs_substeps { self.parameters.substeps } else { 1 };
        self.rapier.integration_parameters.num_solver_iterations = n_substeps;
        for arm in &mut self.arms {
            arm.drive(&mut self.rapier, n_substeps);
            arm.limit_joints(&mut self.rapier, needs_substeps);
        }
    }

    /// Returns the mass of a body in kg, 0 if it is fixed.
    ///
    /// # Panics
    /// If there is no such body.
    #[must_use]
    pub fn body_mass(&self, body: usize) -> f32 {
        self.rapier.bodies[self.bodies[body]].mass()
    }

    /// Returns the number of arms, 1 or 2.
    #[must_use]
    pub fn n_arms(&self) -> usize {
        self.arms.len()
    }

    /// Returns the number of bodies of the scene.
    #[must_use]
    pub fn n_bodies(&self) -> usize {
        self.bodies.len()
    }

    /// Returns the world pose of a body's frame (not of its centre of mass).
    #[must_use]
    pub fn body_pose(&self, body: usize) -> Isometry3<f32> {
        from_pose(self.rapier.bodies[self.bodies[body]].position())
    }

    /// Returns the linear velocity of a body's centre of mass (m/s) and its angular velocity (rad/s), in the
    /// world frame.
    #[must_use]
    pub fn body_velocity(&self, body: usize) -> (Vector3<f32>, Vector3<f32>) {
        let body = &self.rapier.bodies[self.bodies[body]];
        (from_vector(body.linvel()), from_vector(body.angvel()))
    }

    /// Returns the displacement of a jointed body from its start, in m or rad; 0 for any other body.
    #[must_use]
    pub fn joint_position(&self, body: usize) -> f32 {
        let kind = self.joints[body];
        kind.map_or(0.0, |kind| bodies::joint_position(&self.rapier, self.bodies[body], kind))
    }

    /// Returns the maximum penetration depth over all contacts of the last physics step, in m; 0 without
    /// contacts.
    #[must_use]
    pub fn max_penetration(&self) -> f32 {
        let pairs = self.rapier.narrow_phase.contact_pairs();
        let contacts = pairs.filter_map(|pair| pair.find_deepest_contact());
        contacts.map(|(_, contact)| -contact.dist).fold(0.0, f32::max)
    }

    /// Returns the positions of an arm's joints 1 to 7 (rad), then of its two fingers (m).
    #[must_use]
    pub fn qpos(&self, arm: usize) -> [f32; N_DOFS] {
        self.arms[arm].qpos(&self.rapier)
    }

    /// Returns the velocities of an arm's joints 1 to 7 (rad/s), then of its two fingers (m/s).
    #[must_use]
    pub fn qvel(&self, arm: usize) -> [f32; N_DOFS] {
        self.arms[arm].qvel(&self.rapier)
    }

    /// Returns the world pose of an arm's TCP; z is the approach axis, y the closing axis.
    #[must_use]
    pub fn tcp_pose(&self, arm: usize) -> Isometry3<f32> {
        self.arms[arm].tcp_pose(&self.rapier)
    }

    /// Returns `true` if both fingers of an arm press on a body, each with at least 0.5 N and within 85° of
    /// its opening direction.
    #[must_use]
    pub fn is_grasping(&self, arm: usize, body: usize) -> bool {
        self.arms[arm].is_grasping(&self.rapier, self.bodies[body])
    }

    /// Writes the state vector of an observation, `[25]` f32 for one arm or `[64]` for two: qpos, qvel, then
    /// TCP poses as position and quaternion (w, x, y, z). The joints of two arms are interleaved, their
    /// fingers are not, and both TCP poses appear twice, as in the benchmark (docs/benchmark.md,
    /// "Observations").
    ///
    /// # Panics
    /// If `out` has another length.
    pub fn write_state(&self, out: &mut [f32]) {
        let n = self.arms.len();
        let poses_per_arm = n;
        assert_eq!(out.len(), n * (2 * N_DOFS + 7 * poses_per_arm), "the state of {n} arms");
        let (qpos, rest) = out.split_at_mut(n * N_DOFS);
        let (qvel, poses) = rest.split_at_mut(n * N_DOFS);
        for (arm, (q, v)) in (0..n).map(|arm| (self.qpos(arm), self.qvel(arm))).enumerate() {
            for dof in 0..N_DOFS {
                let at = if dof < N_JOINTS { n * dof + arm } else { n * N_JOINTS + 2 * arm + dof - N_JOINTS };
                (qpos[at], qvel[at]) = (q[dof], v[dof]);
            }
        }
        for (i, pose) in poses.chunks_exact_mut(7).enumerate() {
            pose.copy_from_slice(&pose_to_array(&self.tcp_pose(i % n)));
        }
    }

    /// Copies all poses into a snapshot of this scene, without allocating.
    ///
    /// # Panics
    /// If the snapshot was made for another number of bodies or arms.
    pub fn write_snapshot(&self, out: &mut Snapshot) {
        assert_eq!(
            (out.bodies.len(), out.arms.len()),
            (self.bodies.len(), self.arms.len()),
            "the snapshot belongs to another scene"
        );
        for (body, pose) in out.bodies.iter_mut().enumerate() {
            *pose = self.body_pose(body);
        }
        for (arm, links) in self.arms.iter().zip(&mut out.arms) {
            *links = arm.link_poses(&self.rapier);
        }
    }

    /// Adds the full dynamic state to a fingerprint: joint positions and velocities of each arm, pose and
    /// velocity of each body.
    pub fn hash_state(&self, fingerprint: &mut Fingerprint) {
        for arm in 0..self.arms.len() {
            fingerprint.write(&self.qpos(arm));
            fingerprint.write(&self.qvel(arm));
        }
        for body in 0..self.bodies.len() {
            fingerprint.write(&pose_to_array(&self.body_pose(body)));
            let (linear, angular) = self.body_velocity(body);
            fingerprint.write(linear.as_slice());
            fingerprint.write(angular.as_slice());
        }
    }

    /// Returns `true` if every number of the state is finite. If not, the episode cannot be evaluated.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let finite = |numbers: &[f32]| numbers.iter().all(|x| x.is_finite());
        (0..self.arms.len()).all(|arm| finite(&self.qpos(arm)) && finite(&self.qvel(arm)))
            && (0..self.bodies.len()).all(|body| finite(&pose_to_array(&self.body_pose(body))))
    }
}

/// Returns position, then quaternion (w, x, y, z).
fn pose_to_array(pose: &Isometry3<f32>) -> [f32; 7] {
    let (p, q) = (pose.translation.vector, pose.rotation.coords);
    [p.x, p.y, p.z, q.w, q.x, q.y, q.z]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::counting::allocations;
    use crate::{Profile, TaskId};

    #[test]
    fn only_rapier_allocates_in_a_step() {
        for task in TaskId::ALL {
            let spec = (task.task().nominal)(Profile::Strict);
            for mode in [ControlMode::EeDeltaPose, ControlMode::EePose, ControlMode::JointPos] {
                let mut world = World::build(&spec.draw(3), mode);
                let row = vec![0.1; mode.action_dim(task.task().morphology)];
                for _ in 0..20 {
                    let ([n, _], ()) = allocations(|| {
                        world.command(&row);
                        world.drive();
                    });
                    assert_eq!(n, 0, "{} {mode:?}", task.name());
                    world.rapier.step();
                }
            }
        }
    }
}
