//! Choosing among plans where the same thing can be done in several ways.

use crate::expert::{Expert, Move};
use crate::scene::Scene;

/// The first plan that the arms can follow within an episode; the first of all if there is none.
///
/// # Panics
/// If there is no plan.
pub(in crate::tasks) fn first_in_time(
    scene: &Scene,
    max_steps: u32,
    mut plans: impl Iterator<Item = Vec<Move>>,
) -> Vec<Move> {
    let in_time = |moves: &Vec<Move>| {
        Expert::new(scene, moves).is_ok_and(|expert| expert.n_steps() <= max_steps as usize)
    };
    let first = plans.next().expect("there is at least one plan");
    if in_time(&first) { first } else { plans.find(in_time).unwrap_or(first) }
}
