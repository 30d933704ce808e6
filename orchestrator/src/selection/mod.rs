//! The choices of a user by name: tasks, perturbations, the conditions made of both, and policies.

pub(crate) mod condition;
pub(crate) mod names;
pub(crate) mod policy;
pub(crate) mod selectors;
