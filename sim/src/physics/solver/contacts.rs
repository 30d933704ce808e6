//! Contact points of a physics step, and the impulses from which the solver starts.

use rapier3d::geometry::ContactPair;
use rapier3d::math::Vector;
use rapier3d::pipeline::PhysicsWorld;

use super::point::{ContactPoint, Kind, Tag};
use super::{ConstraintRow, Constraints, Contact, Softness, Stop};
use crate::physics::Parameters;
use crate::physics::things::Things;

/// Distance in m below which the contacts of arms are solved. Arms are slow, and each of their contacts costs
/// more than one between free bodies.
const ARM_PREDICTION_M: f32 = 0.004;
/// Distance in m up to which a contact counts as the one of the step before.
const MAX_WANDER_M: f32 = 0.008;
/// Bit of a contact's number in its manifold by which rapier marks new ones.
const NEW_CONTACT: u32 = 1 << 31;

/// The contacts of a world.
#[derive(Default)]
pub(crate) struct Contacts {
    /// Points of the current step, those of a pair of colliders together; first those that are solved.
    pub(crate) points: Vec<ContactPoint>,
    /// Points of the step before, and which of them have a successor.
    previous: Vec<ContactPoint>,
    is_inherited: Vec<bool>,
}

impl Contacts {
    /// Collects the points of the current positions, with the impulses of the last step.
    pub(crate) fn gather(&mut self, world: &PhysicsWorld, parameters: &Parameters) {
        core::mem::swap(&mut self.points, &mut self.previous);
        self.points.clear();
        for pair in world.narrow_phase.contact_pairs() {
            if pair.has_any_active_contact() {
                self.gather_pair(world, pair, parameters);
            }
        }
        self.inherit_impulses();
    }

    /// Takes over the impulses of the step before, first between the same features, then from the nearest
    /// point of the same colliders, because contacts wander from feature to feature.
    fn inherit_impulses(&mut self) {
        let mut next = 0;
        self.is_inherited.clear();
        self.is_inherited.resize(self.previous.len(), false);
        for point in &mut self.points {
            let n = self.previous.len();
            let found = (next..n).chain(0..next).find(|&i| self.previous[i].identity == point.identity);
            if let Some(i) = found {
                point.inherit(&self.previous[i]);
                self.is_inherited[i] = true;
                next = i + 1;
            }
        }
        for point in self.points.iter_mut().filter(|point| point.is_new) {
            let distance = |i: usize| (self.previous[i].position - point.position).length();
            let candidates = (0..self.previous.len()).filter(|&i| {
                !self.is_inherited[i]
                    && self.previous[i].identity[..2] == point.identity[..2]
                    && distance(i) < MAX_WANDER_M
            });
            if let Some(i) = candidates.min_by(|&a, &b| distance(a).total_cmp(&distance(b))) {
                point.inherit(&self.previous[i]);
                self.is_inherited[i] = true;
            }
        }
    }

    fn gather_pair(&mut self, world: &PhysicsWorld, pair: &ContactPair, parameters: &Parameters) {
        let colliders = [pair.collider1, pair.collider2];
        let tags = colliders.map(|collider| Tag::of(world, collider));
        let is_of_arm = tags.iter().any(|tag| tag.is_of_arm());
        let softened = tags.iter().any(|tag| tag.kind == Kind::Finger);
        let [first, second] = colliders.map(|collider| world.colliders[collider].position());
        for manifold in pair.solver_manifolds() {
            for contact in &manifold.data.solver_contacts {
                if is_of_arm && contact.dist >= ARM_PREDICTION_M {
                    continue;
                }
                let point = &manifold.points[(contact.contact_id[0] & !NEW_CONTACT) as usize];
                let gap = contact.dist
                    * if softened && contact.dist < 0.0 { parameters.finger_stiffness } else { 1.0 };
                let [a, b] = colliders.map(|collider| collider.into_raw_parts().0);
                self.points.push(ContactPoint {
                    tags,
                    order: self.points.len(),
                    identity: [a, b, point.fid1.0, point.fid2.0],
                    position: (*first * point.local_p1 + *second * point.local_p2) * 0.5,
                    normal: manifold.data.normal,
                    gap,
                    friction: manifold.data.friction,
                    is_new: true,
                    impulse: 0.0,
                    friction_impulse: Vector::ZERO,
                    step_impulse: 0.0,
                });
            }
        }
    }

    /// Adds the rows of all points at which something is awake, in substeps of `h` seconds of a step of `dt`.
    pub(crate) fn add_rows(
        &mut self,
        rows: &mut Constraints,
        things: &Things,
        parameters: &Parameters,
        [h, dt]: [f32; 2],
    ) {
        let is_solved = |point: &ContactPoint| point.tags.iter().any(|&tag| things.is_awake(tag));
        // A stable sort would allocate.
        self.points.sort_unstable_by_key(|point| {
            (!is_solved(point), point.tags.iter().map(|tag| tag.kind).max(), point.order)
        });
        let n_solved = self.points.partition_point(is_solved);
        let softness = [parameters.contact_hz, parameters.static_contact_hz]
            .map(|frequency| Softness::contact(frequency, parameters.contact_damping, h));
        for pair in self.points[..n_solved].chunk_by(|a, b| a.identity[..2] == b.identity[..2]) {
            rows.starts.push(rows.contacts.len());
            let ContactPoint { tags, normal, friction, .. } = pair[0];
            let mut coefficient = friction;
            if tags.iter().any(|tag| tag.kind == Kind::Finger) {
                let force = pair.iter().map(|point| point.step_impulse).sum::<f32>() / dt;
                let [a, b] = tags.map(|tag| things.angular_velocity(tag));
                let finger = parameters.friction_of_finger(force, (a - b).dot(normal).abs());
                // The coefficient is the mean of the finger's and the body's.
                coefficient += (finger - parameters.finger_friction) / 2.0;
            }
            let softness = softness[usize::from(tags.iter().any(|tag| tag.kind == Kind::Fixed))];
            for point in pair {
                let row = |direction: Vector, impulse| {
                    let [a, b] = tags;
                    let sides = [(a, -direction), (b, direction)];
                    ConstraintRow::new(
                        sides.map(|(tag, direction)| things.side(tag, point.position, direction)),
                        impulse,
                    )
                };
                let (t, u) = point.normal.any_orthonormal_pair();
                rows.contacts.push(Contact {
                    stop: Stop::new(row(point.normal, point.impulse), point.gap, softness),
                    friction: [t, u].map(|tangent| row(tangent, point.friction_impulse.dot(tangent))),
                    tangents: [t, u],
                    coefficient,
                    step_impulse: 0.0,
                });
            }
        }
        rows.starts.push(rows.contacts.len());
    }

    /// Keeps the impulses of a solved step.
    pub(crate) fn remember(&mut self, rows: &Constraints) {
        for (point, contact) in self.points.iter_mut().zip(&rows.contacts) {
            point.impulse = contact.stop.row.impulse;
            point.step_impulse = contact.step_impulse;
            let [t, u] = &contact.friction;
            point.friction_impulse = contact.tangents[0] * t.impulse + contact.tangents[1] * u.impulse;
        }
    }

    /// Returns the sum of the normal impulses that one thing exerted on a link of another in the last step.
    pub(crate) fn impulse_on(&self, link: Tag, by: usize) -> Vector {
        let mut impulse = Vector::ZERO;
        for ContactPoint { tags: [a, b], normal, step_impulse, .. } in &self.points {
            if *a == link && b.thing() == by {
                impulse -= *normal * *step_impulse;
            } else if *b == link && a.thing() == by {
                impulse += *normal * *step_impulse;
            }
        }
        impulse
    }
}
