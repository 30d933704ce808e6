//! The shards of a sweep on their way to one results file: their folder, and the state of each.

mod folder;
mod state;

pub(crate) use self::folder::ShardsFolder;
pub(crate) use self::state::{ShardPhase, ShardState};
