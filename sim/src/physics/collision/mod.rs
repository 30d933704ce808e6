//! Collision detection beyond what rapier offers.

pub(crate) mod hull;
pub(crate) mod separation;
