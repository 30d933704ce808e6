//! The physics world of one environment.

use ipc_types::ControlMode;
use nalgebra::{Isometry3, Vector3};
use rapier3d::geometry::{BroadPhaseBvh, BvhOptimizationStrategy, NarrowPhase};
use rapier3d::parry::query::{DefaultQueryDispatcher, QueryDispatcher};
use rapier3d::pipeline::PhysicsWorld;

use super::arm::Arm;
use super::bodies;
use super::body::PhysicsBody;
use super::collision::separation::SeparatedBoxes;
use super::convert::{from_pose, from_vector};
use super::solver::Constraints;
use super::solver::contacts::Contacts;
use super::things::Things;
use super::{ArmState, BodyState, Parameters, WorldState};
use crate::physics::fingerprint::Fingerprint;
use scene::robot::panda::{N_DOFS, N_JOINTS};
use scene::{Scene, Snapshot};

/// Control steps per second of simulated time.
pub const CONTROL_HZ: f64 = 20.0;

/// The bodies and arms of one scene, driven in one control mode.
pub struct World {
    /// Colliders, whose collisions rapier detects. Their owners are moved by `things`.
    rapier: PhysicsWorld,
    things: Things,
    contacts: Contacts,
    rows: Constraints,
    mode: ControlMode,
    parameters: Parameters,
    physics_hz: u32,
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
    /// If there are no substeps.
    #[must_use]
    pub fn with_parameters(scene: &Scene, mode: ControlMode, parameters: &Parameters) -> Self {
        assert!(parameters.substeps > 0, "a physics step has at least one substep");
        let mut rapier = PhysicsWorld {
            // A tree of a few dozen boxes is not worth rebuilding.
            broad_phase: BroadPhaseBvh::with_optimization_strategy(BvhOptimizationStrategy::None),
            narrow_phase: NarrowPhase::with_query_dispatcher(SeparatedBoxes.chain(DefaultQueryDispatcher)),
            ..PhysicsWorld::default()
        };
        bodies::add_ground(&mut rapier, scene.table.kind);
        let things = scene.bodies.iter().enumerate();
        let bodies: Vec<PhysicsBody> =
            things.map(|(i, body)| bodies::add_body(&mut rapier, body, i + 1)).collect();
        let things = scene.robots.iter().enumerate();
        let arms: Vec<Arm> = things
            .map(|(i, robot)| Arm::add(&mut rapier, robot, mode, parameters, [i, bodies.len() + 1 + i]))
            .collect();
        Self {
            rapier,
            things: Things::new(bodies, arms),
            contacts: Contacts::default(),
            rows: Constraints::default(),
            mode,
            parameters: parameters.clone(),
            physics_hz: scene.physics_hz,
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
        assert_eq!(
            n,
            (self.things.arms.len(), self.things.bodies.len()),
            "the state belongs to another scene"
        );
        for ((body, velocity), state) in self.things.bodies_mut().zip(&state.bodies) {
            body.set_state(velocity, state);
        }
        for ((arm, velocity), state) in self.things.arms_mut().zip(&state.arms) {
            arm.set_state(velocity, state);
        }
        self.things.place(&mut self.rapier);
    }

    /// Executes one control step of 0.05 s. `action` is one row, `[action_dim]` f32: the parts of all arms,
    /// one after another.
    ///
    /// # Panics
    /// If the row has another length.
    pub fn step(&mut self, action: &[f32]) {
        self.command(action);
        for _ in 0..self.physics_hz / CONTROL_HZ as u32 {
            self.detect_collisions();
            self.move_things();
            self.things.place(&mut self.rapier);
        }
    }

    /// Sets the arms' new targets.
    fn command(&mut self, action: &[f32]) {
        let width = match self.mode {
            ControlMode::EeDeltaPose | ControlMode::EePose => N_JOINTS,
            ControlMode::JointPos => N_JOINTS + 1,
        };
        assert_eq!(action.len(), width * self.things.arms.len(), "an action row holds one part per arm");
        for (arm, row) in self.things.arms.iter_mut().zip(action.chunks_exact(width)) {
            arm.command(self.mode, row);
        }
    }

    /// Finds the contacts of the current poses. rapier's narrow phase notes modified pairs in a list that
    /// only its own solver clears, so this list grows for as long as the world exists.
    fn detect_collisions(&mut self) {
        let rapier = &mut self.rapier;
        rapier.collision_pipeline.step(
            self.parameters.prediction_m,
            &mut rapier.islands,
            &mut rapier.broad_phase,
            &mut rapier.narrow_phase,
            &mut rapier.bodies,
            &mut rapier.colliders,
            &(),
            &(),
        );
    }

    /// Advances everything by one physics step from the contacts that were detected.
    fn move_things(&mut self) {
        let Self { rapier, things, contacts, rows, parameters, .. } = self;
        let dt = f64::from(self.physics_hz).recip();
        contacts.gather(rapier, parameters);
        // One substep is enough where no arm pushes.
        let n = if things.find_touching(&contacts.points) { parameters.substeps } else { 1 };
        rows.clear();
        things.begin_step(rows, dt, n);
        let [h, dt] = [dt / n as f64, dt].map(|time| time as f32);
        contacts.add_rows(rows, things, parameters, [h, dt]);
        for substep in 0..n {
            things.begin_substep(substep, n, h);
            rows.warm_start(&mut things.velocities);
            rows.sweep(&mut things.velocities, h, parameters.iterations, true);
            rows.advance(&things.velocities, h);
            things.advance(h);
            rows.sweep(&mut things.velocities, h, parameters.relaxations, false);
            rows.add_up();
        }
        contacts.remember(rows);
        things.finish_step(dt);
    }

    /// Returns the mass of a body in kg, 0 if it is fixed.
    ///
    /// # Panics
    /// If there is no such body.
    #[must_use]
    pub fn body_mass(&self, body: usize) -> f32 {
        self.things.bodies[body].mass(&self.rapier)
    }

    /// Returns the number of arms, 1 or 2.
    #[must_use]
    pub fn n_arms(&self) -> usize {
        self.things.arms.len()
    }

    /// Returns the number of bodies of the scene.
    #[must_use]
    pub fn n_bodies(&self) -> usize {
        self.things.bodies.len()
    }

    /// Returns the world pose of a body's frame (not of its centre of mass).
    #[must_use]
    pub fn body_pose(&self, body: usize) -> Isometry3<f32> {
        from_pose(&self.things.bodies[body].pose)
    }

    /// Returns the linear velocity of a body's centre of mass (m/s) and its angular velocity (rad/s), in the
    /// world frame.
    #[must_use]
    pub fn body_velocity(&self, body: usize) -> (Vector3<f32>, Vector3<f32>) {
        let [linear, angular] = self.things.bodies[body].velocity(&self.things.velocities[body + 1]);
        (from_vector(linear), from_vector(angular))
    }

    /// Returns the displacement of a jointed body from its start, in m or rad; 0 for any other body.
    #[must_use]
    pub fn joint_position(&self, body: usize) -> f32 {
        self.things.bodies[body].joint_position()
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
        self.things.arms[arm].qpos()
    }

    /// Returns the velocities of an arm's joints 1 to 7 (rad/s), then of its two fingers (m/s).
    #[must_use]
    pub fn qvel(&self, arm: usize) -> [f32; N_DOFS] {
        let velocity = self.things.velocities[self.things.bodies.len() + 1 + arm];
        core::array::from_fn(|dof| velocity[dof.min(N_JOINTS)])
    }

    /// Returns the world pose of an arm's TCP; z is the approach axis, y the closing axis.
    #[must_use]
    pub fn tcp_pose(&self, arm: usize) -> Isometry3<f32> {
        self.things.arms[arm].tcp_pose()
    }

    /// Returns `true` if both fingers of an arm press on a body, each with at least 0.5 N and within 85° of
    /// its opening direction.
    #[must_use]
    pub fn is_grasping(&self, arm: usize, body: usize) -> bool {
        let hz = self.physics_hz as f32;
        self.things.arms[arm].is_grasping(|finger| self.contacts.impulse_on(finger, body + 1) * hz)
    }

    /// Writes the state vector of an observation, `[25]` f32 for one arm or `[64]` for two: qpos, qvel, then
    /// TCP poses as position and quaternion (w, x, y, z). The joints of two arms are interleaved, their
    /// fingers are not, and both TCP poses appear twice, as in the benchmark (docs/benchmark.md,
    /// "Observations").
    ///
    /// # Panics
    /// If `out` has another length.
    pub fn write_state(&self, out: &mut [f32]) {
        let n = self.things.arms.len();
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

    /// Returns the current poses of all bodies and links.
    #[must_use]
    pub fn snapshot(&self) -> Snapshot {
        let mut snapshot = Snapshot::identity(self.n_bodies(), self.n_arms());
        self.write_snapshot(&mut snapshot);
        snapshot
    }

    /// Copies all poses into a snapshot of this scene, without allocating.
    ///
    /// # Panics
    /// If the snapshot was made for another number of bodies or arms.
    pub fn write_snapshot(&self, out: &mut Snapshot) {
        assert_eq!(
            (out.bodies.len(), out.arms.len()),
            (self.things.bodies.len(), self.things.arms.len()),
            "the snapshot belongs to another scene"
        );
        for (body, pose) in out.bodies.iter_mut().enumerate() {
            *pose = self.body_pose(body);
        }
        for (arm, links) in self.things.arms.iter().zip(&mut out.arms) {
            *links = arm.link_poses();
        }
    }

    /// Adds the full dynamic state to a fingerprint: joint positions and velocities of each arm, pose and
    /// velocity of each body.
    pub fn hash_state(&self, fingerprint: &mut Fingerprint) {
        for arm in 0..self.things.arms.len() {
            fingerprint.write(&self.qpos(arm));
            fingerprint.write(&self.qvel(arm));
        }
        for body in 0..self.things.bodies.len() {
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
        (0..self.things.arms.len()).all(|arm| finite(&self.qpos(arm)) && finite(&self.qvel(arm)))
            && (0..self.things.bodies.len()).all(|body| finite(&pose_to_array(&self.body_pose(body))))
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

    /// Allocations with which the lists of contacts may grow to their size.
    const MAX_GROWTHS: usize = 40;

    #[test]
    fn only_collision_detection_allocates_in_a_step() {
        for task in TaskId::ALL {
            let spec = (task.task().nominal)(Profile::Strict);
            for mode in [ControlMode::EeDeltaPose, ControlMode::EePose, ControlMode::JointPos] {
                let mut world = World::build(&spec.draw(3), mode);
                let row = vec![0.1; mode.action_dim(task.task().morphology)];
                let mut n_allocations = 0;
                for _ in 0..100 {
                    world.detect_collisions();
                    let ([n, _], ()) = allocations(|| {
                        world.command(&row);
                        world.move_things();
                    });
                    n_allocations += n;
                    world.things.place(&mut world.rapier);
                }
                assert!(n_allocations < MAX_GROWTHS, "{} {mode:?}: {n_allocations}", task.name());
            }
        }
    }
}
