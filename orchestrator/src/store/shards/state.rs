//! The state of a shard in a file beside its results: who runs it, and how far it is.

use std::io;
use std::path::Path;

use run_config::input;
use serde::{Deserialize, Serialize};

/// Most bytes of a message in a state.
const MAX_MESSAGE: usize = 2000;

/// The state of a shard. While a task runs it, the file is rewritten every few seconds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct ShardState {
    /// Index of the shard.
    pub(crate) shard: u32,
    /// Number of shards of the sweep.
    pub(crate) shards: u32,
    pub(crate) phase: ShardPhase,
    /// Name of the machine.
    pub(crate) host: String,
    /// Process id of the task on it.
    pub(crate) pid: u32,
    /// Random name of the task.
    pub(crate) token: String,
    /// Number of times that the task has written this file.
    pub(crate) beat: u64,
    /// Number of episodes of the shard.
    pub(crate) planned: u64,
    /// Number of finished ones, those of earlier tasks included.
    pub(crate) done: u64,
    /// Number of those of earlier tasks.
    pub(crate) done_before: u64,
    /// Number of episodes that the task could not run.
    pub(crate) errors: u64,
    /// Time since the task began, in s.
    pub(crate) wall_s: f64,
    /// The error that ended the task.
    pub(crate) message: Option<String>,
}

/// The phase of a shard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum ShardPhase {
    /// A task runs it, or was killed while it did.
    Running,
    /// It has all its episodes.
    Finished,
    /// A signal ended the task in order; the next one resumes.
    Interrupted,
    /// An error ended the task.
    Failed,
}

impl ShardState {
    /// Reads the state at `path`; `None` if there is none.
    ///
    /// # Errors
    /// If the file cannot be read or contains something else.
    pub(crate) fn read(path: &Path) -> io::Result<Option<Self>> {
        match input::read(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            read => Ok(Some(serde_json::from_slice(&read?)?)),
        }
    }

    /// Replaces the file at `path` by this state. Readers see the one or the other.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn write(&self, path: &Path) -> io::Result<()> {
        let mut state = self.clone();
        if let Some(message) = &mut state.message {
            message.truncate(message.floor_char_boundary(MAX_MESSAGE));
        }
        let next = path.with_extension(format!("{}.tmp", self.token));
        std::fs::write(&next, serde_json::to_vec(&state)?)?;
        std::fs::rename(&next, path)
    }

    /// Returns the finished episodes per second of this task; `None` before the first one.
    pub(crate) fn episodes_per_s(&self) -> Option<f64> {
        let own = self.done.checked_sub(self.done_before).filter(|n| *n > 0)?;
        (self.wall_s > 0.0).then(|| own as f64 / self.wall_s)
    }
}
