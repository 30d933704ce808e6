//! Chunks of views: their size, and the records that the device reads.

pub(crate) mod batch;
pub(crate) mod records;
pub(crate) mod shadow;
pub(crate) mod size;
