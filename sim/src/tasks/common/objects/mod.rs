//! Other bodies of several tasks.

pub(crate) mod arrow;
pub(crate) mod book;
pub(crate) mod hole;
pub(crate) mod pen_and_cap;
pub(crate) mod props;
pub(crate) mod ring_and_needle;
pub(crate) mod tools;
