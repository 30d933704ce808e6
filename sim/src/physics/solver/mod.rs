//! Forces between things that move, by the soft-step method.
//!
//! A physics step has one or two substeps. Each advances the velocities by all forces other than these,
//! starts from the impulses of the substep before, sweeps over all rows while springs and dampers recover
//! penetration, advances positions, and sweeps again without recovery, which leaves no velocity behind
//! (Catto, "Solver2D", 2024; rapier's own solver is of this kind). All things share one form of velocity, so
//! that a contact between two bodies, two arms, or an arm and a drawer is the same code.

pub(crate) mod contacts;
pub(crate) mod point;
pub(crate) mod sleep;

use rapier3d::dynamics::SpringCoefficients;
use rapier3d::math::Vector;

/// Maximum number of generalized coordinates of a thing: those of an arm.
pub(crate) const N_COORDINATES: usize = 8;
/// Generalized velocity or position. A free body has the velocity of its centre of mass, then its angular
/// velocity; a body on a joint has the joint's; an arm has those of joints 1 to 7, then that of both fingers.
pub(crate) type Coordinates = [f32; N_COORDINATES];

/// Maximum velocity at which penetration is recovered, in m/s.
const MAX_RECOVERY: f32 = 0.3;

/// Number of the ground, which never moves, among the things of a world.
pub(crate) const GROUND: usize = 0;

/// One thing's part in a row.
#[derive(Clone, Copy)]
pub(crate) struct RowSide {
    pub(crate) thing: usize,
    /// Velocity along the row per generalized velocity.
    pub(crate) jacobian: Coordinates,
    /// Change of the generalized velocity per impulse along the row.
    pub(crate) response: Coordinates,
}

impl RowSide {
    /// Returns the part of a thing that cannot move.
    pub(crate) const fn fixed() -> Self {
        Self { thing: GROUND, jacobian: [0.0; N_COORDINATES], response: [0.0; N_COORDINATES] }
    }
}

/// A direction in which two things push each other.
pub(crate) struct ConstraintRow {
    /// The ground has zero Jacobian and response, so both sides are computed without a branch.
    sides: [RowSide; 2],
    /// Impulse that changes the relative velocity by 1; 0 if neither side can move.
    mass: f32,
    /// Impulse of the current substep.
    pub(crate) impulse: f32,
}

impl ConstraintRow {
    pub(crate) fn new(sides: [RowSide; 2], impulse: f32) -> Self {
        let [a, b] = &sides;
        let compliance = dot(&a.jacobian, &a.response) + dot(&b.jacobian, &b.response);
        Self { sides, mass: if compliance > 0.0 { compliance.recip() } else { 0.0 }, impulse }
    }

    /// Returns the relative velocity along the row.
    fn velocity(&self, velocities: &[Coordinates]) -> f32 {
        let [a, b] = &self.sides;
        dot(&a.jacobian, &velocities[a.thing]) + dot(&b.jacobian, &velocities[b.thing])
    }

    fn push(&self, velocities: &mut [Coordinates], impulse: f32) {
        for side in &self.sides {
            for (v, response) in velocities[side.thing].iter_mut().zip(&side.response) {
                *v += response * impulse;
            }
        }
    }

    fn set_impulse(&mut self, velocities: &mut [Coordinates], impulse: f32) {
        // Most contact points of a pair are slightly apart and carry no impulse.
        if impulse == self.impulse {
            return;
        }
        self.push(velocities, impulse - self.impulse);
        self.impulse = impulse;
    }
}

/// Spring and damper of a row in a substep.
#[derive(Clone, Copy)]
pub(crate) struct Softness {
    /// Recovery velocity per distance, in 1/s.
    recovery: f32,
    /// Factor on the impulse; 1 if rigid.
    factor: f32,
}

impl Softness {
    /// Returns the softness of a contact of a natural frequency (Hz) and damping ratio in a substep of `h` s.
    pub(crate) fn contact(frequency: f32, damping_ratio: f32, h: f32) -> Self {
        let spring = SpringCoefficients::new(frequency, damping_ratio);
        Self { recovery: spring.erp_inv_dt(h), factor: spring.cfm_factor(h) }
    }

    /// Returns the softness of a joint limit in a substep of `h` s: none.
    pub(crate) fn rigid(h: f32) -> Self {
        Self { recovery: h.recip(), factor: 1.0 }
    }
}

/// A row that can push but not pull, and only where a gap has closed.
pub(crate) struct Stop {
    pub(crate) row: ConstraintRow,
    /// Gap at the current positions, in m or rad; negative if penetrated.
    gap: f32,
    softness: Softness,
    /// Velocity that the sweeps add to that of the row, and factor on the impulse.
    target: f32,
    factor: f32,
}

impl Stop {
    pub(crate) const fn new(row: ConstraintRow, gap: f32, softness: Softness) -> Self {
        Self { row, gap, softness, target: 0.0, factor: 1.0 }
    }

    fn prepare(&mut self, h: f32, recover: bool) {
        (self.target, self.factor) = if self.gap > 0.0 {
            (self.gap / h, 1.0)
        } else if recover {
            ((self.gap * self.softness.recovery).max(-MAX_RECOVERY), self.softness.factor)
        } else {
            (0.0, 1.0)
        };
    }

    fn sweep(&mut self, velocities: &mut [Coordinates]) {
        let error = self.row.velocity(velocities) + self.target;
        let impulse = self.factor * (self.row.impulse - self.row.mass * error);
        self.row.set_impulse(velocities, impulse.max(0.0));
    }
}

/// Dry friction of a joint.
pub(crate) struct Brake {
    pub(crate) row: ConstraintRow,
    /// Maximum impulse of a substep.
    pub(crate) max_impulse: f32,
}

/// A point at which two colliders touch or are about to.
pub(crate) struct Contact {
    /// Along the normal.
    pub(crate) stop: Stop,
    /// Along both tangents.
    pub(crate) friction: [ConstraintRow; 2],
    pub(crate) tangents: [Vector; 2],
    /// Friction coefficient.
    pub(crate) coefficient: f32,
    /// Normal impulse of the whole physics step, in N·s.
    pub(crate) step_impulse: f32,
}

impl Contact {
    fn sweep_friction(&mut self, velocities: &mut [Coordinates]) {
        if self.stop.row.impulse == 0.0 && self.friction.iter().all(|row| row.impulse == 0.0) {
            return;
        }
        let wanted = self.friction.each_ref().map(|row| row.impulse - row.mass * row.velocity(velocities));
        let size = (wanted[0] * wanted[0] + wanted[1] * wanted[1]).sqrt();
        let limit = self.coefficient * self.stop.row.impulse;
        let scale = if size > limit { limit / size } else { 1.0 };
        for (row, wanted) in self.friction.iter_mut().zip(wanted) {
            row.set_impulse(velocities, wanted * scale);
        }
    }
}

/// Everything that a substep solves.
#[derive(Default)]
pub(crate) struct Constraints {
    pub(crate) brakes: Vec<Brake>,
    pub(crate) limits: Vec<Stop>,
    /// Contacts, those of one pair of colliders next to each other.
    pub(crate) contacts: Vec<Contact>,
    /// First contact of each pair, and the number of contacts.
    pub(crate) starts: Vec<usize>,
}

impl Constraints {
    pub(crate) fn clear(&mut self) {
        self.brakes.clear();
        self.limits.clear();
        self.contacts.clear();
        self.starts.clear();
    }

    /// Applies the impulses of the substep before.
    pub(crate) fn warm_start(&self, velocities: &mut [Coordinates]) {
        let joints = self.brakes.iter().map(|brake| &brake.row).chain(self.limits.iter().map(|it| &it.row));
        let contacts = self.contacts.iter();
        let contacts = contacts.flat_map(|it| core::iter::once(&it.stop.row).chain(&it.friction));
        for row in joints.chain(contacts) {
            row.push(velocities, row.impulse);
        }
    }

    /// Sweeps `n` times over all rows in a substep of `h` seconds. Friction acts only without recovery.
    pub(crate) fn sweep(&mut self, velocities: &mut [Coordinates], h: f32, n: usize, recover: bool) {
        for stop in self.limits.iter_mut().chain(self.contacts.iter_mut().map(|contact| &mut contact.stop)) {
            stop.prepare(h, recover);
        }
        for _ in 0..n {
            for Brake { row, max_impulse } in &mut self.brakes {
                let impulse = row.impulse - row.mass * row.velocity(velocities);
                row.set_impulse(velocities, impulse.clamp(-*max_impulse, *max_impulse));
            }
            for limit in &mut self.limits {
                limit.sweep(velocities);
            }
            for pair in self.starts.windows(2) {
                let pair = &mut self.contacts[pair[0]..pair[1]];
                for contact in &mut *pair {
                    contact.stop.sweep(velocities);
                }
                if !recover {
                    for contact in pair {
                        contact.sweep_friction(velocities);
                    }
                }
            }
        }
    }

    /// Moves everything for `h` seconds.
    pub(crate) fn advance(&mut self, velocities: &[Coordinates], h: f32) {
        for stop in self.limits.iter_mut().chain(self.contacts.iter_mut().map(|contact| &mut contact.stop)) {
            stop.gap += h * stop.row.velocity(velocities);
        }
    }

    /// Completes a substep.
    pub(crate) fn add_up(&mut self) {
        for contact in &mut self.contacts {
            contact.step_impulse += contact.stop.row.impulse;
        }
    }
}

/// Returns the sum of products, in an order that suits four lanes.
fn dot(a: &Coordinates, b: &Coordinates) -> f32 {
    let lanes: [f32; 4] = core::array::from_fn(|i| a[i] * b[i] + a[i + 4] * b[i + 4]);
    (lanes[0] + lanes[1]) + (lanes[2] + lanes[3])
}
