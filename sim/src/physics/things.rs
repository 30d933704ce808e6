//! All that a world contains besides the ground: bodies and arms, with one form of velocity.

use rapier3d::math::Vector;
use rapier3d::pipeline::PhysicsWorld;

use super::arm::Arm;
use super::body::PhysicsBody;
use super::solver::point::{ContactPoint, Kind, Tag};
use super::solver::{Constraints, Coordinates, N_COORDINATES, RowSide, sleep};

/// Bodies and arms. A thing's number is 0 for the ground, then counts the bodies, then the arms.
pub(crate) struct Things {
    pub(crate) bodies: Vec<PhysicsBody>,
    pub(crate) arms: Vec<Arm>,
    /// Velocities of all things; that of the ground is 0.
    pub(crate) velocities: Vec<Coordinates>,
    /// Workspace of [`sleep::update`].
    groups: Vec<usize>,
}

impl Things {
    pub(crate) fn new(bodies: Vec<PhysicsBody>, arms: Vec<Arm>) -> Self {
        let velocities = vec![[0.0; N_COORDINATES]; 1 + bodies.len() + arms.len()];
        Self { bodies, arms, velocities, groups: Vec::new() }
    }

    /// Returns each body with its velocity.
    pub(crate) fn bodies_mut(&mut self) -> impl Iterator<Item = (&mut PhysicsBody, &mut Coordinates)> {
        self.bodies.iter_mut().zip(&mut self.velocities[1..])
    }

    /// Returns each arm with its velocity.
    pub(crate) fn arms_mut(&mut self) -> impl Iterator<Item = (&mut Arm, &mut Coordinates)> {
        self.arms.iter_mut().zip(&mut self.velocities[1 + self.bodies.len()..])
    }

    fn awake_bodies(&mut self) -> impl Iterator<Item = (&mut PhysicsBody, &mut Coordinates)> {
        self.bodies_mut().filter(|(body, _)| !body.is_asleep)
    }

    fn touching_arms(&mut self) -> impl Iterator<Item = (&mut Arm, &mut Coordinates)> {
        self.arms_mut().filter(|(arm, _)| arm.touches)
    }

    /// Determines which bodies sleep and which arms touch something. Returns `true` if any arm does.
    pub(crate) fn find_touching(&mut self, points: &[ContactPoint]) -> bool {
        sleep::update(&mut self.bodies, points, &mut self.groups);
        for (body, velocity) in self.bodies_mut() {
            if body.is_asleep {
                *velocity = [0.0; N_COORDINATES];
            }
        }
        for arm in &mut self.arms {
            let is_own = |tag: &Tag| tag.is_of_arm() && tag.thing() == arm.thing;
            arm.touches = points.iter().any(|point| point.tags.iter().any(is_own));
        }
        self.arms.iter().any(|arm| arm.touches)
    }

    /// Prepares a physics step of `dt` seconds with `n` substeps. Arms that touch nothing move at once.
    pub(crate) fn begin_step(&mut self, rows: &mut Constraints, dt: f64, n: usize) {
        let h = dt / n as f64;
        for (i, body) in self.bodies.iter_mut().enumerate().filter(|(_, body)| !body.is_asleep) {
            body.begin_step(h as f32);
            body.add_rows(rows, i + 1, h as f32);
        }
        for (arm, velocity) in self.arms_mut() {
            arm.predict(velocity, dt);
            if arm.touches {
                arm.begin_step(h);
                arm.add_rows(rows, h as f32);
            } else {
                arm.move_freely(velocity);
            }
        }
    }

    /// Advances velocities by all forces other than those of the rows, in one of `n` substeps of `h` seconds.
    pub(crate) fn begin_substep(&mut self, substep: usize, n: usize, h: f32) {
        for (body, velocity) in self.awake_bodies() {
            body.begin_substep(velocity, h);
        }
        for (arm, velocity) in self.touching_arms() {
            arm.begin_substep(velocity, substep, n, h);
        }
    }

    /// Moves everything for `h` seconds.
    pub(crate) fn advance(&mut self, h: f32) {
        for (body, velocity) in self.awake_bodies() {
            body.advance(velocity, h);
        }
        for (arm, velocity) in self.touching_arms() {
            arm.advance(velocity, h);
        }
    }

    /// Completes a physics step of `dt` seconds.
    pub(crate) fn finish_step(&mut self, dt: f32) {
        for (body, velocity) in self.awake_bodies() {
            body.finish_step(velocity, dt);
        }
        for (arm, velocity) in self.touching_arms() {
            arm.finish_step(velocity);
        }
    }

    /// Moves all colliders to their owners.
    pub(crate) fn place(&self, world: &mut PhysicsWorld) {
        for body in &self.bodies {
            body.place(world);
        }
        for arm in &self.arms {
            arm.place(world);
        }
    }

    fn body(&self, tag: Tag) -> &PhysicsBody {
        &self.bodies[tag.thing() - 1]
    }

    fn arm(&self, tag: Tag) -> &Arm {
        &self.arms[tag.thing() - 1 - self.bodies.len()]
    }

    /// Returns `true` if the owner of a collider can move in this step.
    pub(crate) fn is_awake(&self, tag: Tag) -> bool {
        match tag.kind {
            Kind::Fixed => false,
            Kind::Free | Kind::Jointed => !self.body(tag).is_asleep,
            Kind::Link | Kind::Finger => true,
        }
    }

    /// Returns the part of a collider's owner in a row through a point.
    pub(crate) fn side(&self, tag: Tag, point: Vector, direction: Vector) -> RowSide {
        match tag.kind {
            Kind::Fixed => RowSide::fixed(),
            Kind::Free | Kind::Jointed => self.body(tag).side(tag.thing(), point, direction),
            Kind::Link | Kind::Finger => self.arm(tag).side(tag.link.into(), point, direction),
        }
    }

    /// Returns the angular velocity of a collider's owner, in rad/s.
    pub(crate) fn angular_velocity(&self, tag: Tag) -> Vector {
        let velocity = &self.velocities[tag.thing()];
        match tag.kind {
            Kind::Fixed => Vector::ZERO,
            Kind::Free | Kind::Jointed => self.body(tag).velocity(velocity)[1],
            Kind::Link | Kind::Finger => self.arm(tag).angular_velocity(tag.link.into(), velocity),
        }
    }
}
