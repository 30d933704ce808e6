//! Sleep of bodies at rest: groups that touch each other fall asleep and wake up together.

use super::point::{ContactPoint, Kind};
use crate::physics::body::PhysicsBody;

/// Number, in the groups, of everything that keeps others awake: the arms and restless bodies.
const AWAKE: usize = 0;

/// Lets groups of touching bodies sleep in which all have been still for a while, and wakes all others. The
/// numbers of the bodies among the world's things start at 1. `groups` is a workspace.
pub(crate) fn update(bodies: &mut [PhysicsBody], points: &[ContactPoint], groups: &mut Vec<usize>) {
    groups.clear();
    groups.push(AWAKE);
    groups.extend(bodies.iter().enumerate().map(|(i, body)| if body.is_restless() { AWAKE } else { i + 1 }));
    for tags in points.iter().map(|point| point.tags) {
        if tags.iter().all(|tag| tag.kind != Kind::Fixed) {
            let [a, b] = tags.map(|tag| if tag.is_of_arm() { AWAKE } else { root(groups, tag.thing()) });
            groups[a.max(b)] = a.min(b);
        }
    }
    for (i, body) in bodies.iter_mut().enumerate() {
        let is_awake = root(groups, i + 1) == AWAKE;
        if body.is_asleep && is_awake {
            body.wake();
        }
        body.is_asleep = !is_awake;
    }
}

fn root(groups: &[usize], mut thing: usize) -> usize {
    while groups[thing] != thing {
        thing = groups[thing];
    }
    thing
}
