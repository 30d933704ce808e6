//! One body of the scene: how it moves between the impulses of the solver.

use rapier3d::dynamics::RigidBodyHandle;
use rapier3d::geometry::ColliderHandle;
use rapier3d::math::{Matrix, Pose, Rotation, Vector};
use rapier3d::pipeline::PhysicsWorld;

use super::BodyState;
use super::convert::{to_pose, to_vector};
use super::solver::{Brake, ConstraintRow, Constraints, Coordinates, N_COORDINATES, RowSide, Softness, Stop};
use scene::{Body, JointKind, JointSpec, Motion};

/// Gravitational acceleration along world z, in m/s².
const GRAVITY: f32 = -9.81;
/// Speed of its fastest point, in m/s, below which a body counts as still, and the time in s after which it
/// sleeps, if all that touches it is as still.
const STILL_SPEED: f32 = 0.01;
const TIME_UNTIL_SLEEP: f32 = 0.5;

/// A body of the scene, as it moves.
pub(crate) struct PhysicsBody {
    handle: RigidBodyHandle,
    /// World pose of the body's frame.
    pub(crate) pose: Pose,
    motion: BodyMotion,
    /// Centre of mass in the body's frame, in m.
    com: Vector,
    /// Distance from it within which all colliders lie, in m.
    extent: f32,
    /// Time in s for which the body has hardly moved.
    still_s: f32,
    pub(crate) is_asleep: bool,
}

/// Motion of a body, and its state during a step.
enum BodyMotion {
    Fixed,
    Free {
        inverse_mass: f32,
        /// In the body's frame.
        inverse_inertia: Matrix,
        /// Linear and angular, in 1/s.
        damping: [f32; 2],
        /// World position of the centre of mass, rotation, and inverse inertia in the world frame.
        centre: Vector,
        rotation: Rotation,
        world_inverse_inertia: Matrix,
    },
    Jointed {
        joint: JointSpec,
        /// Pose at joint position 0, and direction of the joint in the world frame.
        start: Pose,
        axis: Vector,
        mass: f32,
        /// Mass or moment of inertia about the axis, in kg or kg·m².
        inertia: f32,
        /// Joint position in m or rad.
        position: f32,
        /// Reciprocal of the inertia with the joint's damping in the current substep.
        response: f32,
    },
}

impl PhysicsBody {
    /// Describes a body that was added to rapier.
    pub(crate) fn new(world: &PhysicsWorld, handle: RigidBodyHandle, body: &Body) -> Self {
        let rigid = &world.bodies[handle];
        let properties = &rigid.mass_properties().local_mprops;
        let com = properties.local_com;
        let radius = |collider: ColliderHandle| {
            let collider = &world.colliders[collider];
            let sphere = collider.shape().compute_local_bounding_sphere();
            let pose = collider.position_wrt_parent().copied().unwrap_or_default();
            (pose * sphere.center - com).length() + sphere.radius
        };
        let extent = rigid.colliders().iter().map(|&it| radius(it)).fold(0.0, f32::max);
        let start = *rigid.position();
        let motion = match body.motion {
            Motion::Fixed | Motion::VisualOnly => BodyMotion::Fixed,
            Motion::Dynamic => BodyMotion::Free {
                inverse_mass: properties.inv_mass,
                inverse_inertia: properties.reconstruct_inverse_inertia_matrix(),
                damping: body.damping.map(|damping| damping as f32),
                centre: Vector::ZERO,
                rotation: Rotation::IDENTITY,
                world_inverse_inertia: Matrix::IDENTITY,
            },
            Motion::Jointed(joint) => {
                let axis = to_vector(&joint.axis.into());
                let inertia = match joint.kind {
                    JointKind::Slide => properties.mass(),
                    JointKind::Hinge => {
                        let about_com = axis.dot(properties.reconstruct_inertia_matrix() * axis);
                        about_com + properties.mass() * axis.cross(com).length_squared()
                    }
                };
                BodyMotion::Jointed {
                    joint,
                    start,
                    axis: start.rotation * axis,
                    mass: properties.mass(),
                    inertia,
                    position: 0.0,
                    response: 0.0,
                }
            }
        };
        Self { handle, pose: start, motion, com, extent, still_s: 0.0, is_asleep: false }
    }

    /// Prepares a physics step with substeps of `h` seconds.
    pub(crate) fn begin_step(&mut self, h: f32) {
        match &mut self.motion {
            BodyMotion::Fixed => {}
            BodyMotion::Free { inverse_inertia, centre, rotation, world_inverse_inertia, .. } => {
                *centre = self.pose * self.com;
                *rotation = self.pose.rotation;
                let to_world = Matrix::from_quat(self.pose.rotation);
                *world_inverse_inertia = to_world * *inverse_inertia * to_world.transpose();
            }
            BodyMotion::Jointed { joint, inertia, response, .. } => {
                *response = (*inertia + h * joint.damping as f32).recip();
            }
        }
    }

    /// Applies gravity and damping of the joint for a substep of `h` seconds.
    pub(crate) fn begin_substep(&self, velocity: &mut Coordinates, h: f32) {
        match &self.motion {
            BodyMotion::Fixed => {}
            BodyMotion::Free { .. } => velocity[2] += GRAVITY * h,
            BodyMotion::Jointed { joint, axis, mass, inertia, response, .. } => {
                let weight = Vector::new(0.0, 0.0, *mass * GRAVITY);
                let force = match joint.kind {
                    JointKind::Slide => axis.dot(weight),
                    JointKind::Hinge => {
                        let lever = self.pose.rotation * self.com;
                        axis.dot(lever.cross(weight))
                    }
                };
                velocity[0] = (*inertia * velocity[0] + h * force) * *response;
            }
        }
    }

    /// Adds the rows of the joint's friction and limits in substeps of `h` seconds.
    pub(crate) fn add_rows(&self, rows: &mut Constraints, thing: usize, h: f32) {
        let BodyMotion::Jointed { joint, position, response, .. } = &self.motion else { return };
        let row = |sign: f32| {
            let [jacobian, response] = [sign, sign * response].map(first_coordinate);
            ConstraintRow::new([RowSide { thing, jacobian, response }, RowSide::fixed()], 0.0)
        };
        rows.brakes.push(Brake { row: row(1.0), max_impulse: joint.friction as f32 * h });
        rows.limits.push(Stop::new(row(1.0), *position, Softness::rigid(h)));
        rows.limits.push(Stop::new(row(-1.0), joint.upper as f32 - position, Softness::rigid(h)));
    }

    /// Returns the body's part in a row through a point.
    pub(crate) fn side(&self, thing: usize, point: Vector, direction: Vector) -> RowSide {
        match &self.motion {
            BodyMotion::Fixed => RowSide::fixed(),
            BodyMotion::Free { inverse_mass, centre, world_inverse_inertia, .. } => {
                let moment = (point - *centre).cross(direction);
                let spatial = |linear: Vector, angular: Vector| {
                    [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z, 0.0, 0.0]
                };
                RowSide {
                    thing,
                    jacobian: spatial(direction, moment),
                    response: spatial(direction * *inverse_mass, *world_inverse_inertia * moment),
                }
            }
            BodyMotion::Jointed { joint, start, axis, response, .. } => {
                let along = match joint.kind {
                    JointKind::Slide => direction.dot(*axis),
                    JointKind::Hinge => direction.dot(axis.cross(point - start.translation)),
                };
                let [jacobian, response] = [along, along * response].map(first_coordinate);
                RowSide { thing, jacobian, response }
            }
        }
    }

    /// Moves the body for `h` seconds.
    pub(crate) fn advance(&mut self, velocity: &Coordinates, h: f32) {
        match &mut self.motion {
            BodyMotion::Fixed => {}
            BodyMotion::Free { centre, rotation, .. } => {
                let [x, y, z, wx, wy, wz, ..] = *velocity;
                *centre += Vector::new(x, y, z) * h;
                let spin = Rotation::from_xyzw(wx, wy, wz, 0.0) * *rotation;
                *rotation = (*rotation + spin * (0.5 * h)).normalize();
            }
            BodyMotion::Jointed { position, .. } => *position += velocity[0] * h,
        }
    }

    /// Completes a step of `dt` seconds: applies damping, and measures how still the body is.
    pub(crate) fn finish_step(&mut self, velocity: &mut Coordinates, dt: f32) {
        let pose = match &self.motion {
            BodyMotion::Fixed => return,
            BodyMotion::Free { centre, rotation, damping, .. } => {
                for (i, v) in velocity.iter_mut().enumerate() {
                    *v /= 1.0 + dt * damping[i / 3 % 2];
                }
                Pose::from_parts(*centre - *rotation * self.com, *rotation)
            }
            BodyMotion::Jointed { joint, start, axis, position, .. } => {
                jointed_pose(joint.kind, start, *axis, *position)
            }
        };
        let before = core::mem::replace(&mut self.pose, pose);
        let turn = (pose.rotation * before.rotation.inverse()).xyz().length() * 2.0;
        let drift = (pose * self.com - before * self.com).length() + turn * self.extent;
        self.still_s = if drift < STILL_SPEED * dt { self.still_s + dt } else { 0.0 };
    }

    /// Moves the colliders to the body's pose.
    pub(crate) fn place(&self, world: &mut PhysicsWorld) {
        if *world.bodies[self.handle].position() != self.pose {
            world.bodies[self.handle].set_position(self.pose, false);
        }
    }

    /// Returns `true` if the body can move and has done so lately.
    pub(crate) fn is_restless(&self) -> bool {
        !matches!(self.motion, BodyMotion::Fixed) && self.still_s < TIME_UNTIL_SLEEP
    }

    /// Returns the mass in kg, 0 if the body is fixed.
    pub(crate) fn mass(&self, world: &PhysicsWorld) -> f32 {
        world.bodies[self.handle].mass()
    }

    /// Wakes the body up.
    pub(crate) fn wake(&mut self) {
        (self.is_asleep, self.still_s) = (false, 0.0);
    }

    /// Returns the joint position of a jointed body, in m or rad; 0 for any other.
    pub(crate) fn joint_position(&self) -> f32 {
        if let BodyMotion::Jointed { position, .. } = self.motion { position } else { 0.0 }
    }

    /// Returns the linear velocity of the centre of mass (m/s) and the angular velocity (rad/s).
    pub(crate) fn velocity(&self, velocity: &Coordinates) -> [Vector; 2] {
        match &self.motion {
            BodyMotion::Fixed => [Vector::ZERO; 2],
            BodyMotion::Free { .. } => {
                let [x, y, z, wx, wy, wz, ..] = *velocity;
                [Vector::new(x, y, z), Vector::new(wx, wy, wz)]
            }
            BodyMotion::Jointed { joint, axis, .. } => {
                let along = *axis * velocity[0];
                match joint.kind {
                    JointKind::Slide => [along, Vector::ZERO],
                    JointKind::Hinge => {
                        let lever = self.pose.rotation * self.com;
                        [along.cross(lever), along]
                    }
                }
            }
        }
    }

    /// Sets pose and velocity. A jointed body is moved to the joint position nearest to the pose, and only
    /// the part of the velocity along the joint counts.
    pub(crate) fn set_state(&mut self, velocity: &mut Coordinates, state: &BodyState) {
        let [linear, angular] =
            [&state.linear_velocity, &state.angular_velocity].map(|v| to_vector(&v.cast()));
        let pose = to_pose(&state.pose.cast());
        self.pose = match &mut self.motion {
            BodyMotion::Fixed => pose,
            BodyMotion::Free { .. } => {
                *velocity = [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z, 0.0, 0.0];
                pose
            }
            BodyMotion::Jointed { joint, start, axis, position, .. } => {
                (*position, velocity[0]) = match joint.kind {
                    JointKind::Slide => {
                        ((pose.translation - start.translation).dot(*axis), linear.dot(*axis))
                    }
                    JointKind::Hinge => {
                        let turned = pose.rotation * start.rotation.inverse();
                        let angle = 2.0 * libm::atan2f(turned.xyz().dot(*axis), turned.w);
                        let turn = core::f32::consts::TAU;
                        let near = *position;
                        (angle - turn * libm::roundf((angle - near) / turn), angular.dot(*axis))
                    }
                };
                jointed_pose(joint.kind, start, *axis, *position)
            }
        };
        self.wake();
    }
}

/// Returns coordinates of which only the first is not 0.
fn first_coordinate(value: f32) -> Coordinates {
    let mut coordinates = [0.0; N_COORDINATES];
    coordinates[0] = value;
    coordinates
}

/// Returns the pose of a jointed body at a joint position (m or rad).
fn jointed_pose(kind: JointKind, start: &Pose, axis: Vector, position: f32) -> Pose {
    match kind {
        JointKind::Slide => Pose::from_parts(start.translation + axis * position, start.rotation),
        JointKind::Hinge => {
            let (sin, cos) = libm::sincosf(position / 2.0);
            let turn = Rotation::from_xyzw(axis.x * sin, axis.y * sin, axis.z * sin, cos);
            Pose::from_parts(start.translation, (turn * start.rotation).normalize())
        }
    }
}
