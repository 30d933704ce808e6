//! The progress of an episode.

use run_config::EpisodeEnd;
use thiserror::Error;

use crate::physics::fingerprint::Fingerprint;
use crate::physics::{World, WorldState};
use crate::predicate::{Predicate, first_unmet};

/// The physics state is no longer finite.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error("the physics state is not finite after step {step}")]
pub struct DivergedError {
    /// Number of control steps executed.
    pub step: u32,
}

/// Returns the memory of an env with or without images in bytes, a little more than measured.
#[must_use]
pub const fn env_bytes(has_images: bool) -> u64 {
    if has_images { 900 << 10 } else { 160 << 10 }
}

/// An episode in progress: its world and its outcome so far.
pub(crate) struct Episode {
    pub(crate) world: World,
    success: Vec<Predicate>,
    fingerprint: Fingerprint,
    steps: u32,
    first_success_step: Option<u32>,
    /// First predicate that does not hold in the current state.
    unmet: Option<Predicate>,
}

impl Episode {
    /// Starts an episode in the present state of a world.
    pub(crate) fn new(world: World, success: Vec<Predicate>) -> Self {
        let mut fingerprint = Fingerprint::default();
        world.hash_state(&mut fingerprint);
        let unmet = first_unmet(&success, &world);
        Self { world, success, fingerprint, steps: 0, first_success_step: None, unmet }
    }

    /// Starts the episode anew from a state of its world.
    pub(crate) fn restart(&mut self, state: &WorldState) {
        self.world.set_state(state);
        self.fingerprint = Fingerprint::default();
        self.world.hash_state(&mut self.fingerprint);
        self.unmet = first_unmet(&self.success, &self.world);
        (self.steps, self.first_success_step) = (0, None);
    }

    /// Executes an action row, `[action_dim]`.
    pub(crate) fn step(&mut self, row: &[f32]) -> Result<(), DivergedError> {
        self.world.step(row);
        self.steps += 1;
        self.fingerprint.write(row);
        self.world.hash_state(&mut self.fingerprint);
        if !self.world.is_finite() {
            return Err(DivergedError { step: self.steps });
        }
        self.unmet = first_unmet(&self.success, &self.world);
        if self.unmet.is_none() {
            self.first_success_step.get_or_insert(self.steps);
        }
        Ok(())
    }

    /// Returns the number of control steps executed.
    pub(crate) const fn steps(&self) -> u32 {
        self.steps
    }

    /// Returns the first step after which all success predicates held, counted from 1.
    pub(crate) const fn first_success_step(&self) -> Option<u32> {
        self.first_success_step
    }

    /// Returns `true` if the episode has ended by its success.
    pub(crate) fn is_won(&self, end: EpisodeEnd) -> bool {
        end == EpisodeEnd::Success && self.first_success_step.is_some()
    }

    /// Returns `true` if the episode has ended, by its success or after `max_steps`.
    pub(crate) fn is_over(&self, end: EpisodeEnd, max_steps: u32) -> bool {
        self.is_won(end) || self.steps >= max_steps
    }

    /// Returns the first success predicate that does not hold in the current state.
    pub(crate) const fn unmet(&self) -> Option<Predicate> {
        self.unmet
    }

    /// Returns the hash of the initial state, then every executed row and the state after it.
    pub(crate) fn fingerprint(&self) -> u64 {
        self.fingerprint.finish()
    }
}
