//! Points at which colliders touch, and the owners of colliders.

use rapier3d::geometry::ColliderHandle;
use rapier3d::math::Vector;
use rapier3d::pipeline::PhysicsWorld;

/// Owner of a collider.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Tag {
    /// Number among the world's things.
    pub(crate) thing: u16,
    /// Link of an arm, 1 to 7, or 8 and 9 for the fingers; 0 for anything else.
    pub(crate) link: u8,
    pub(crate) kind: Kind,
}

/// Kind of what a collider belongs to. Contacts are solved in the order of the greater of their kinds,
/// because the row that is solved last has no error left.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Kind {
    Free,
    Fixed,
    Jointed,
    Link,
    Finger,
}

const KINDS: [Kind; 5] = [Kind::Free, Kind::Fixed, Kind::Jointed, Kind::Link, Kind::Finger];

impl Tag {
    pub(crate) const fn new(thing: usize, link: usize, kind: Kind) -> Self {
        Self { thing: thing as u16, link: link as u8, kind }
    }

    /// Returns the number among the world's things.
    pub(crate) fn thing(self) -> usize {
        self.thing.into()
    }

    /// Returns the user data of a collider.
    pub(crate) fn to_user_data(self) -> u128 {
        u128::from(self.thing) << 16 | u128::from(self.link) << 8 | self.kind as u128
    }

    /// Returns the owner of a collider.
    pub(crate) fn of(world: &PhysicsWorld, collider: ColliderHandle) -> Self {
        let data = world.colliders[collider].user_data;
        Self { thing: (data >> 16) as u16, link: (data >> 8) as u8, kind: KINDS[data as u8 as usize] }
    }

    /// Returns `true` if the collider belongs to a moving link.
    pub(crate) fn is_of_arm(self) -> bool {
        self.kind >= Kind::Link
    }
}

/// A point at which two colliders touch or are about to.
#[derive(Clone, Copy)]
pub(crate) struct ContactPoint {
    pub(crate) tags: [Tag; 2],
    /// Number among the step's points in the order of detection.
    pub(crate) order: usize,
    /// Colliders and features that meet here, the same in every step of a lasting contact.
    pub(crate) identity: [u32; 4],
    /// Midpoint between the surfaces, in m.
    pub(crate) position: Vector,
    /// Direction from the first to the second collider.
    pub(crate) normal: Vector,
    /// Distance in m; negative if penetrated.
    pub(crate) gap: f32,
    pub(crate) friction: f32,
    /// `true` if the step before had no such point.
    pub(crate) is_new: bool,
    /// Normal and friction impulse of the last substep and normal impulse of the whole step, in N·s.
    pub(crate) impulse: f32,
    pub(crate) friction_impulse: Vector,
    pub(crate) step_impulse: f32,
}

impl ContactPoint {
    /// Takes over the impulses of the step before.
    pub(crate) fn inherit(&mut self, old: &Self) {
        self.is_new = false;
        (self.impulse, self.friction_impulse, self.step_impulse) =
            (old.impulse, old.friction_impulse, old.step_impulse);
    }
}
