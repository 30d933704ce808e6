//! One arm: construction, joint drives and state readout.
//!
//! The motion of an arm that touches nothing is known (`robot::dynamics`). A contact deflects it through the
//! inertia matrix with the drives' springs and dampers, so that the arm yields as the drives do.

use ipc_types::ControlMode;
use nalgebra::{Isometry3, Translation3, Vector3};
use rapier3d::dynamics::{RigidBodyBuilder, RigidBodyHandle};
use rapier3d::geometry::InteractionGroups;
use rapier3d::math::{Pose, Vector};
use rapier3d::pipeline::PhysicsWorld;

use super::bodies::{HAND, LINK, collider, collision_groups};
use super::convert::{from_pose, from_vector, to_pose, to_vector};
use super::solver::point::{Kind, Tag};
use super::solver::{ConstraintRow, Constraints, Coordinates, N_COORDINATES, RowSide, Softness, Stop};
use super::{ArmState, Parameters};
use crate::robot::control::{Drive, FINGER_DRIVE, Targets, arm_drive, targets};
use crate::robot::dynamics::{self, Dynamics, JointMatrix, LinkInertias, Path};
use scene::robot::kinematics::{self, Joints};
use scene::robot::panda::{
    CollisionShape, FINGER_OPEN, LOWER, N_DOFS, N_JOINTS, UPPER, finger_in_link7, finger_inertia,
    finger_shapes, hand_in_link7, hand_shapes, link_shapes, tcp_in_link7,
};
use scene::{ArmLinks, Link, N_LINKS, Robot};

/// Friction coefficient of links and hand.
const LINK_FRICTION: f32 = 0.3;
/// Coordinate of both fingers, which move alike, as in the original.
const FINGERS: usize = N_JOINTS;
/// Number of the link that is the first finger.
const FIRST_FINGER: usize = N_JOINTS + 1;
/// Maximum speed of a joint after a physics step, in rad/s or m/s: the default of PhysX.
const MAX_JOINT_SPEED: f32 = 100.0;
/// Distance from a joint limit within which the limit is part of the solver's problem, in rad and m: farther
/// than a joint moves in a physics step.
const NEAR_LIMIT: [f32; 2] = [0.1, 0.01];
/// Minimum force on each finger for a grasp, in N.
const MIN_GRASP_FORCE_N: f32 = 0.5;
/// Cosine of the maximum angle, 85°, between that force and the finger's opening direction.
const MIN_GRASP_COS: f32 = 0.087_155_74;

/// One arm in a world.
pub(crate) struct Arm {
    /// Number among the world's things.
    pub(crate) thing: usize,
    /// `true` if the current physics step has contacts of this arm.
    pub(crate) touches: bool,
    /// Links 0 to 7, then the two fingers, and their world poses.
    links: [(RigidBodyHandle, Pose); N_DOFS + 1],
    base: Isometry3<f64>,
    drive: Drive,
    targets: Targets,
    inertias: LinkInertias,
    /// Positions of joints 1 to 7 (rad) and of both fingers (m).
    position: Coordinates,
    /// Poses of links 1 to 7 at these positions, in the base frame.
    poses: [Isometry3<f64>; N_JOINTS],
    /// The current physics step if the arm touches nothing.
    free: FreeMotion,
    response: Response,
    hand_in_link7: Isometry3<f32>,
    tcp_in_link7: Isometry3<f32>,
}

/// A physics step of an arm that touches nothing.
#[derive(Default)]
struct FreeMotion {
    /// Positions on the way, of the joints and of the fingers.
    path: (Path<Joints>, Path<f64>),
    /// Velocities after the step.
    velocity: Coordinates,
    /// Inertia matrix of the joints, in kg·m².
    inertia: JointMatrix,
}

impl FreeMotion {
    /// Returns the mean velocities in one of `n` substeps, each of `h` seconds.
    fn mean_velocity(&self, substep: usize, n: usize, h: f64) -> Coordinates {
        let (joints, finger) = &self.path;
        let n_iterations = joints.len() - 1;
        let at = |substep: usize| {
            let time = (substep * n_iterations) as f64 / n as f64;
            let (before, share) = ((time as usize).min(n_iterations - 1), time.fract());
            (before, if substep == n { 1.0 } else { share })
        };
        let position = |i: usize, (before, share): (usize, f64)| {
            let [a, b] = [before, before + 1].map(|k| if i == FINGERS { finger[k] } else { joints[k][i] });
            a + (b - a) * share
        };
        let (from, to) = (at(substep), at(substep + 1));
        core::array::from_fn(|i| ((position(i, to) - position(i, from)) / h) as f32)
    }
}

/// Effect of impulses on the motion, in substeps of one length.
#[derive(Default)]
struct Response {
    /// Inverse of the inertia matrix with the drives' springs and dampers.
    inverse: [Coordinates; N_COORDINATES],
    /// Axes in the world frame: of the joints, and along which the first finger opens. Points on them.
    axes: [Vector; N_COORDINATES],
    points: [Vector; N_JOINTS],
    /// Velocities of the current substep in free motion, and sum of the deviations from it so far.
    free: Coordinates,
    deviation: Coordinates,
}

impl Arm {
    /// Adds an arm at its start pose with open fingers. Its targets are its start positions. `number` is 0 or
    /// 1, and `thing` its number among the world's things.
    pub(crate) fn add(
        world: &mut PhysicsWorld,
        robot: &Robot,
        mode: ControlMode,
        parameters: &Parameters,
        [number, thing]: [usize; 2],
    ) -> Self {
        let own = LINK[number] | HAND[number];
        let [link_groups, hand_groups] = [LINK, HAND].map(|group| collision_groups(group[number], !own));
        let mut add_link = |link: usize, shapes: &[CollisionShape], friction, groups| {
            let builder = if link == 0 { RigidBodyBuilder::fixed() } else { RigidBodyBuilder::dynamic() };
            let body = world.insert_body(builder.pose(to_pose(&robot.base)));
            add_shapes(world, body, Tag::new(thing, link, kind_of(link)), shapes, friction, groups);
            body
        };
        let links: [RigidBodyHandle; N_DOFS + 1] = core::array::from_fn(|link| match link {
            0..=N_JOINTS => add_link(link, &link_shapes(link), LINK_FRICTION, link_groups),
            _ => {
                let side = if link == FIRST_FINGER { 1.0 } else { -1.0 };
                add_link(link, &finger_shapes(side), parameters.finger_friction, hand_groups)
            }
        });
        let hand = Tag::new(thing, N_JOINTS, Kind::Link);
        add_shapes(world, links[N_JOINTS], hand, &hand_shapes(), LINK_FRICTION, hand_groups);
        let joints = Joints::from(robot.qpos);
        let mut arm = Self {
            thing,
            touches: false,
            links: links.map(|link| (link, to_pose(&robot.base))),
            base: robot.base,
            drive: arm_drive(mode),
            targets: Targets { joints, finger: FINGER_OPEN },
            inertias: LinkInertias::default(),
            position: coordinates(&joints, FINGER_OPEN),
            poses: kinematics::links(&joints),
            free: FreeMotion::default(),
            response: Response::default(),
            hand_in_link7: hand_in_link7().cast(),
            tcp_in_link7: tcp_in_link7().cast(),
        };
        arm.move_links();
        arm.place(world);
        arm
    }

    /// Sets positions and velocities of all joints. Both fingers get the mean of theirs. The targets become
    /// the positions.
    pub(crate) fn set_state(&mut self, velocity: &mut Coordinates, state: &ArmState) {
        [self.position, *velocity] = [&state.qpos, &state.qvel].map(|dofs| {
            core::array::from_fn(|i| if i == FINGERS { (dofs[i] + dofs[i + 1]) / 2.0 } else { dofs[i] })
        });
        self.targets = Targets { joints: self.joints(), finger: f64::from(self.position[FINGERS]) };
        self.move_links();
    }

    fn joints(&self) -> Joints {
        Joints::from_fn(|joint, _| f64::from(self.position[joint]))
    }

    /// Moves the links to the positions of the joints.
    fn move_links(&mut self) {
        self.poses = kinematics::links(&self.joints());
        let hand = self.poses[N_JOINTS - 1] * finger_in_link7();
        for (i, (_, pose)) in self.links.iter_mut().enumerate().skip(1) {
            let in_base = match i {
                1..=N_JOINTS => self.poses[i - 1],
                _ => {
                    let side = if i == FIRST_FINGER { 1.0 } else { -1.0 };
                    hand * Translation3::new(0.0, side * f64::from(self.position[FINGERS]), 0.0)
                }
            };
            *pose = to_pose(&(self.base * in_base));
        }
    }

    /// Moves the colliders to the links.
    pub(crate) fn place(&self, world: &mut PhysicsWorld) {
        for (link, pose) in &self.links {
            if world.bodies[*link].position() != pose {
                world.bodies[*link].set_position(*pose, false);
            }
        }
    }

    /// Sets new targets from this arm's part of an action row, [`Targets`] in `mode`.
    pub(crate) fn command(&mut self, mode: ControlMode, row: &[f32]) {
        self.targets = targets(mode, row, &self.joints());
    }

    /// Predicts a physics step of `dt` seconds in which the arm touches nothing.
    pub(crate) fn predict(&mut self, velocity: &Coordinates, dt: f64) {
        let q = self.joints();
        let mut v = Joints::from_fn(|joint, _| f64::from(velocity[joint]));
        let Dynamics { inertia, bias } = self.inertias.at(&self.poses, &v);
        let inverse = inverse(inertia);
        let joints = dynamics::advance(&q, &mut v, &self.targets.joints, self.drive, &inverse, &bias, dt);
        let (q, mut finger_v) = (f64::from(self.position[FINGERS]), f64::from(velocity[FINGERS]));
        let finger = dynamics::advance_finger(q, &mut finger_v, self.targets.finger, FINGER_DRIVE, dt);
        self.free = FreeMotion { path: (joints, finger), velocity: coordinates(&v, finger_v), inertia };
    }

    /// Takes the predicted step.
    pub(crate) fn move_freely(&mut self, velocity: &mut Coordinates) {
        let (joints, finger) = &self.free.path;
        let end = joints.len() - 1;
        (self.position, *velocity) = (coordinates(&joints[end], finger[end]), self.free.velocity);
        self.arrive(velocity);
    }

    /// Ends a step. No joint is left faster than [`MAX_JOINT_SPEED`] or beyond its limit.
    fn arrive(&mut self, velocity: &mut Coordinates) {
        for (i, (q, v)) in self.position.iter_mut().zip(velocity).enumerate() {
            let [min, max] = limits_of(i);
            let lowest = if *q <= min { 0.0 } else { -MAX_JOINT_SPEED };
            let highest = if *q >= max { 0.0 } else { MAX_JOINT_SPEED };
            (*q, *v) = (q.clamp(min, max), v.clamp(lowest, highest));
        }
        self.move_links();
    }

    /// Prepares for contacts in substeps of `h` seconds.
    pub(crate) fn begin_step(&mut self, h: f64) {
        let Drive { stiffness: k, damping: d, .. } = self.drive;
        let matrix = self.free.inertia + JointMatrix::identity() * (h * d + h * h * k);
        let inverse = inverse(matrix);
        let Drive { stiffness: k, damping: d, .. } = FINGER_DRIVE;
        let fingers = 2.0 * (finger_inertia().mass + h * d + h * h * k);
        let entry = |row: usize, column: usize| match (row, column) {
            (FINGERS, FINGERS) => fingers.recip() as f32,
            (FINGERS, _) | (_, FINGERS) => 0.0,
            _ => inverse[(row, column)] as f32,
        };
        let poses = self.poses.map(|pose| self.base * pose);
        let opening = poses[N_JOINTS - 1].rotation * finger_in_link7().rotation * Vector3::y();
        self.response = Response {
            inverse: core::array::from_fn(|row| core::array::from_fn(|column| entry(row, column))),
            axes: core::array::from_fn(|i| {
                if i == FINGERS {
                    to_vector(&opening)
                } else {
                    to_vector(&(poses[i].rotation * Vector3::z()))
                }
            }),
            points: poses.map(|pose| to_vector(&pose.translation.vector)),
            free: [0.0; N_COORDINATES],
            deviation: [0.0; N_COORDINATES],
        };
    }

    /// Adds the rows of the joint limits that are near, in substeps of `h` seconds.
    pub(crate) fn add_rows(&self, rows: &mut Constraints, h: f32) {
        for (dof, &q) in self.position.iter().enumerate() {
            let [min, max] = limits_of(dof);
            for (sign, gap) in [(1.0, q - min), (-1.0, max - q)] {
                if gap < NEAR_LIMIT[usize::from(dof == FINGERS)] {
                    let mut jacobian = [0.0; N_COORDINATES];
                    jacobian[dof] = sign;
                    let row = ConstraintRow::new([self.side_along(jacobian), RowSide::fixed()], 0.0);
                    rows.limits.push(Stop::new(row, gap, Softness::rigid(h)));
                }
            }
        }
    }

    /// Returns the arm's part in a row through a point of a link.
    pub(crate) fn side(&self, link: usize, point: Vector, direction: Vector) -> RowSide {
        let mut jacobian = [0.0; N_COORDINATES];
        let Response { axes, points, .. } = &self.response;
        for joint in 0..link.min(N_JOINTS) {
            jacobian[joint] = axes[joint].dot((point - points[joint]).cross(direction));
        }
        if link >= FIRST_FINGER {
            let along = axes[FINGERS].dot(direction);
            jacobian[FINGERS] = if link == FIRST_FINGER { along } else { -along };
        }
        self.side_along(jacobian)
    }

    fn side_along(&self, jacobian: Coordinates) -> RowSide {
        let mut response = [0.0; N_COORDINATES];
        for (column, factor) in self.response.inverse.iter().zip(jacobian) {
            for i in 0..N_COORDINATES {
                response[i] += column[i] * factor;
            }
        }
        RowSide { thing: self.thing, jacobian, response }
    }

    /// Returns the angular velocity of a link, in rad/s.
    pub(crate) fn angular_velocity(&self, link: usize, velocity: &Coordinates) -> Vector {
        let axes = self.response.axes.iter().zip(velocity).take(link.min(N_JOINTS));
        axes.map(|(axis, v)| *axis * *v).sum()
    }

    /// Advances the velocity by the drives for a substep. Without contacts, each has the mean velocity of its
    /// part of the free motion; from a deviation, the springs and dampers pull back.
    ///
    /// With the inertia matrix M and the drives' stiffness K and damping D, an implicit substep of length h
    /// maps the deviation δ of the velocity and the sum σ of all before to δ − A⁻¹ ((h D + h² K) δ + h² K
    /// σ), where A is M + h D + h² K.
    pub(crate) fn begin_substep(&mut self, velocity: &mut Coordinates, substep: usize, n: usize, h: f32) {
        let free = self.free.mean_velocity(substep, n, f64::from(h));
        if substep == 0 {
            *velocity = free;
            self.response.free = free;
            return;
        }
        let pull = core::array::from_fn(|i| {
            let (drive, n) = if i == FINGERS { (FINGER_DRIVE, 2.0) } else { (self.drive, 1.0) };
            let [k, d] = [drive.stiffness, drive.damping].map(|gain| n * gain as f32);
            let deviation = velocity[i] - self.response.free[i];
            self.response.deviation[i] += deviation;
            velocity[i] = free[i] + deviation;
            (h * d + h * h * k) * deviation + h * h * k * self.response.deviation[i]
        });
        self.response.free = free;
        for (v, change) in velocity.iter_mut().zip(self.side_along(pull).response) {
            *v -= change;
        }
    }

    /// Moves the joints for `h` seconds.
    pub(crate) fn advance(&mut self, velocity: &Coordinates, h: f32) {
        for (q, v) in self.position.iter_mut().zip(velocity) {
            *q += v * h;
        }
    }

    /// Completes a step with contacts. Its substeps have the mean velocities of the free motion, which ends
    /// at another one.
    pub(crate) fn finish_step(&mut self, velocity: &mut Coordinates) {
        for (i, v) in velocity.iter_mut().enumerate() {
            *v += self.free.velocity[i] - self.response.free[i];
        }
        self.arrive(velocity);
    }

    /// Returns the positions of joints 1 to 7 (rad) and of the fingers (m).
    pub(crate) fn qpos(&self) -> [f32; N_DOFS] {
        core::array::from_fn(|dof| self.position[dof.min(FINGERS)])
    }

    fn link_pose(&self, link: usize) -> Isometry3<f32> {
        from_pose(&self.links[link].1)
    }

    /// Returns the TCP pose in the world frame.
    pub(crate) fn tcp_pose(&self) -> Isometry3<f32> {
        self.link_pose(N_JOINTS) * self.tcp_in_link7
    }

    /// Returns the poses of all links in the world frame.
    pub(crate) fn link_poses(&self) -> ArmLinks {
        let mut poses: [Isometry3<f32>; N_LINKS] = core::array::from_fn(|link| match link {
            0..=N_JOINTS => self.link_pose(link),
            _ => self.link_pose(link - 1),
        });
        poses[Link::Hand as usize] = poses[Link::Link7 as usize] * self.hand_in_link7;
        poses
    }

    /// Returns `true` if both fingers pressed on something in the last physics step, each with at least 0.5 N
    /// and within 85° of its opening direction. `force_on` returns the force on a finger, in N.
    pub(crate) fn is_grasping(&self, force_on: impl Fn(Tag) -> Vector) -> bool {
        [FIRST_FINGER, FIRST_FINGER + 1].into_iter().all(|link| {
            let opening = self.link_pose(link).rotation * Vector3::y();
            let opening = if link == FIRST_FINGER { opening } else { -opening };
            let force = from_vector(force_on(Tag::new(self.thing, link, Kind::Finger)));
            let size = force.norm();
            size >= MIN_GRASP_FORCE_N && force.dot(&opening) >= MIN_GRASP_COS * size
        })
    }
}

/// Returns the inverse of a positive definite matrix. Any other stems from a state that has diverged and
/// yields NaN, which ends the episode.
fn inverse(matrix: JointMatrix) -> JointMatrix {
    matrix.cholesky().map_or_else(|| JointMatrix::repeat(f64::NAN), |factor| factor.inverse())
}

fn coordinates(joints: &Joints, finger: f64) -> Coordinates {
    core::array::from_fn(|i| if i == FINGERS { finger as f32 } else { joints[i] as f32 })
}

/// Returns the minimum and maximum position of a joint, in rad or m.
const fn limits_of(dof: usize) -> [f32; 2] {
    if dof < N_JOINTS { [LOWER[dof] as f32, UPPER[dof] as f32] } else { [0.0, FINGER_OPEN as f32] }
}

const fn kind_of(link: usize) -> Kind {
    match link {
        0 => Kind::Fixed,
        1..=N_JOINTS => Kind::Link,
        _ => Kind::Finger,
    }
}

/// Adds collision shapes to a link.
fn add_shapes(
    world: &mut PhysicsWorld,
    link: RigidBodyHandle,
    tag: Tag,
    shapes: &[CollisionShape],
    friction: f32,
    groups: InteractionGroups,
) {
    for (shape, pose) in shapes {
        let builder = collider(shape, pose, tag, groups).density(0.0).friction(friction);
        world.insert_collider(builder, Some(link));
    }
}
