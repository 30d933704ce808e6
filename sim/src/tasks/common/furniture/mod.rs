//! Furniture of several tasks.

pub(crate) mod bookcase;
pub(crate) mod cabinet;
pub(crate) mod chest;
pub(crate) mod drawer_unit;
