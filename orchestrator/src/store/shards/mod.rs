//! The shards of a sweep on their way to one results file: their folder, what they agree on, the state of
//! each, and the task that runs one.

mod folder;
mod saver;
mod state;
mod sweep;
mod task;

pub(crate) use self::folder::{ShardsFolder, results_files};
pub(crate) use self::state::{ShardPhase, ShardState};
pub(crate) use self::sweep::SharedSweep;
pub(crate) use self::task::ShardTask;
