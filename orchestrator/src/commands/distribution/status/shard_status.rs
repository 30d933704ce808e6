//! One shard as its state in the folder shows it.

use std::io;
use std::path::PathBuf;
use std::time::{Duration, SystemTime};

use serde::Serialize;
use thiserror::Error;

use crate::plan::partition::SweepShard;
use crate::store::shards::{ShardPhase, ShardState, ShardsFolder};

/// Number of attempts to read a state. On a network file system, a file may be replaced meanwhile.
const N_ATTEMPTS: u32 = 3;
/// Time between two attempts.
const PAUSE: Duration = Duration::from_millis(50);

/// The condition of a shard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum ShardHealth {
    Finished,
    Running,
    Interrupted,
    Failed,
    /// Its task was killed, or cannot write any more.
    Silent,
    /// No task has begun it.
    Waiting,
}

impl ShardHealth {
    pub(crate) const ALL: [Self; 6] =
        [Self::Finished, Self::Running, Self::Interrupted, Self::Failed, Self::Silent, Self::Waiting];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Finished => "finished",
            Self::Running => "running",
            Self::Interrupted => "interrupted",
            Self::Failed => "failed",
            Self::Silent => "silent",
            Self::Waiting => "waiting",
        }
    }
}

/// A shard with its state, if a task has begun it.
#[derive(Clone, Debug)]
pub(crate) struct ShardStatus {
    pub(crate) shard: SweepShard,
    pub(crate) health: ShardHealth,
    pub(crate) state: Option<ShardState>,
}

/// Errors that can occur while reading the state of a shard.
#[derive(Debug, Error)]
pub(crate) enum StateError {
    #[error("failed to read the state {}", path.display())]
    Read { path: PathBuf, source: io::Error },
    #[error("the state {} belongs to shard {found}/{count}", path.display())]
    OtherShard { path: PathBuf, found: u32, count: u32 },
}

impl ShardStatus {
    /// Reads the state of a shard. If it runs, but its state was written before `oldest`, it is silent.
    ///
    /// # Errors
    /// If the state cannot be read, or belongs to another shard.
    pub(crate) fn read(
        folder: &ShardsFolder,
        shard: SweepShard,
        oldest: Option<SystemTime>,
    ) -> Result<Self, StateError> {
        let path = folder.state(shard);
        let mut attempt = 1;
        let read = loop {
            let written = std::fs::metadata(&path).and_then(|metadata| metadata.modified());
            match ShardState::read(&path) {
                Err(_) if attempt < N_ATTEMPTS => std::thread::sleep(PAUSE),
                read => break read.map(|state| (state, written.ok())),
            }
            attempt += 1;
        };
        let (state, written) = match read {
            Ok((Some(state), written)) => (state, written),
            Ok((None, _)) => return Ok(Self { shard, health: ShardHealth::Waiting, state: None }),
            Err(source) => return Err(StateError::Read { path, source }),
        };
        if (state.shard, state.shards) != (shard.index, shard.count) {
            return Err(StateError::OtherShard { path, found: state.shard, count: state.shards });
        }
        let health = match state.phase {
            ShardPhase::Finished => ShardHealth::Finished,
            ShardPhase::Interrupted => ShardHealth::Interrupted,
            ShardPhase::Failed => ShardHealth::Failed,
            ShardPhase::Running if oldest.zip(written).is_some_and(|(oldest, written)| written < oldest) => {
                ShardHealth::Silent
            }
            ShardPhase::Running => ShardHealth::Running,
        };
        Ok(Self { shard, health, state: Some(state) })
    }

    /// Returns the time in s until the shard has finished, if it is running at a known speed.
    pub(crate) fn left_s(&self) -> Option<f64> {
        let state = self.state.as_ref()?;
        self.episodes_per_s().map(|rate| state.planned.saturating_sub(state.done) as f64 / rate)
    }

    /// Returns the finished episodes per second, if the shard is running and has any.
    pub(crate) fn episodes_per_s(&self) -> Option<f64> {
        let state = self.state.as_ref().filter(|_| self.health == ShardHealth::Running)?;
        state.episodes_per_s()
    }
}
