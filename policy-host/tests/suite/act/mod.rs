//! ACT: its checkpoint formats, and its actions against those of other implementations.

mod checkpoint;
mod folders;
mod independence;
pub(crate) mod lerobot;
pub(crate) mod parity;
