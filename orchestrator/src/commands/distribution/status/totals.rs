//! Sums over the shards of a sweep.

use std::fmt;

use serde::Serialize;

use crate::commands::distribution::status::shard_status::{ShardHealth, ShardStatus};
use crate::console::progress::format_seconds;

/// Episodes, speed and time left of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct SweepTotals {
    pub(crate) done: u64,
    /// Number of episodes of the sweep. Shards that no task has begun count as many as the others on average.
    pub(crate) planned: u64,
    pub(crate) planned_is_estimated: bool,
    /// Number of episodes that could not be run.
    pub(crate) errors: u64,
    /// Speed of the running shards together.
    pub(crate) episodes_per_s: f64,
    /// Time in s until the last running shard has finished; `None` if none is running at a known speed.
    pub(crate) left_s: Option<f64>,
    /// `true` if the sweep will take longer, because not all unfinished shards are running.
    pub(crate) left_is_bound: bool,
}

impl SweepTotals {
    /// Adds up the states of all shards.
    pub(crate) fn of(shards: &[ShardStatus]) -> Self {
        let states = || shards.iter().filter_map(|shard| shard.state.as_ref());
        let (n_begun, known) = (states().count(), states().map(|state| state.planned).sum::<u64>());
        let per_shard = known as f64 / n_begun.max(1) as f64;
        let unknown = (per_shard * (shards.len() - n_begun) as f64).round() as u64;
        let unfinished = || shards.iter().filter(|shard| shard.health != ShardHealth::Finished);
        Self {
            done: states().map(|state| state.done).sum(),
            planned: known + unknown,
            planned_is_estimated: n_begun < shards.len(),
            errors: states().map(|state| state.errors).sum(),
            episodes_per_s: shards.iter().filter_map(ShardStatus::episodes_per_s).sum(),
            left_s: shards.iter().filter_map(ShardStatus::left_s).reduce(f64::max),
            left_is_bound: unfinished().any(|shard| shard.left_s().is_none()),
        }
    }
}

impl fmt::Display for SweepTotals {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { done, planned, errors, episodes_per_s, .. } = self;
        let about = if self.planned_is_estimated { "about " } else { "" };
        write!(f, "{done} of {about}{planned} episodes")?;
        if *errors > 0 {
            write!(f, ", {errors} not run")?;
        }
        if let Some(left_s) = self.left_s {
            let at_least = if self.left_is_bound { "at least " } else { "" };
            write!(f, ", {episodes_per_s:.2} episodes/s, {at_least}{} left", format_seconds(left_s))?;
        }
        Ok(())
    }
}
