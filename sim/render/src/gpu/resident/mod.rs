//! Contents of the device that last longer than a chunk.

pub(crate) mod assets;
pub(crate) mod scenes;
