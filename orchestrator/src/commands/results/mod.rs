//! Commands on stored results.

pub(crate) mod compare;
pub(crate) mod pack;
pub(crate) mod replay;
pub(crate) mod report;
mod trajectory;
pub(crate) mod verify;
