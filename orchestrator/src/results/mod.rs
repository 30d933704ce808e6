//! The results file: SQLite, written by one orchestrator at a time, one transaction per finished episode.
//!
//! It owns the table `episodes` (one complete row per finished episode), the table `manifest` (the
//! configuration that the rows depend on) and the rules of resuming. It never overwrites a row, unless that
//! row has an error.

mod gaps;
mod manifest;
mod open;
mod recorded;
mod rows;
mod schema;

use std::collections::BTreeSet;
use std::fs::File;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use rusqlite::{Connection, params};
use sim::serve::protocol::Outcome;
use thiserror::Error;

pub(crate) use self::gaps::{Gap, gaps};
pub(crate) use self::manifest::{ENVIRONMENT, Manifest, PLANS, STOPPING};
pub(crate) use self::open::{ResultsFileError, copy_snapshot};
pub(crate) use self::recorded::RecordedEpisodes;
pub(crate) use self::rows::{EpisodeRow, ResultsFile};
use crate::plan::{Condition, RunPlan};
use crate::stored_episode::format_fingerprint;

/// An open results file.
#[derive(Debug)]
pub(crate) struct Results {
    connection: Connection,
    path: PathBuf,
    // Excludes a second writer until the connection is closed. SQLite's own POSIX locks are lost when any
    // descriptor of the file is closed, so this descriptor must outlive the connection.
    lock: File,
}

/// The primary key of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct EpisodeKey<'a> {
    /// Name of the policy.
    pub(crate) policy: &'a str,
    pub(crate) condition: Condition,
    /// Index of the episode under the suite seed.
    pub(crate) episode: u32,
}

/// The finished episodes of a results file.
#[derive(Clone, Debug, Default)]
pub(crate) struct FinishedEpisodes(BTreeSet<(String, String, String, u32)>);

/// Sums over the episodes of one policy under one condition.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct CellSums {
    /// Episodes that finished without an error.
    pub(crate) n: u32,
    /// Those with success after any step.
    pub(crate) success_once: u32,
    /// Those with success after the last step.
    pub(crate) success_at_end: u32,
    /// Control steps of all of them.
    pub(crate) steps: u64,
    /// Episodes that ended with an error; not in `n`.
    pub(crate) errors: u32,
}

/// An error that occurred while reading or writing an open results file.
#[derive(Debug, Error)]
pub(crate) enum StoreError {
    #[error("failed to read the results file {}", path.display())]
    Read { path: PathBuf, source: rusqlite::Error },
    #[error(
        "failed to write to the results file {}: {cause}; finished episodes are stored, and the same command resumes",
        path.display()
    )]
    Write { path: PathBuf, cause: String },
    #[error(
        "failed to write to the results file {}: it was deleted or replaced during the run; run the same command again",
        path.display()
    )]
    Gone { path: PathBuf },
}

impl Results {
    /// Opens or creates the results file at `path` for a run with this manifest.
    ///
    /// # Errors
    /// If it is not a results file of this version, has rows with another manifest, is in use, or cannot be
    /// written.
    pub(crate) fn open(path: &Path, manifest: &Manifest) -> Result<Self, ResultsFileError> {
        let (connection, lock) = open::open(path)?;
        manifest::reconcile(&connection, path, manifest)?;
        Ok(Self { connection, path: path.into(), lock })
    }

    /// Stores a note that results do not depend on, replacing an earlier one with the same key.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn note(&self, key: &str, value: &serde_json::Value) -> Result<(), StoreError> {
        manifest::put(&self.connection, key, value).map_err(|error| self.not_written(error))
    }

    /// Adds the plan of a run to those of the file, so that missing episodes can be noticed.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn add_plan(&self, plan: &RunPlan) -> Result<(), StoreError> {
        manifest::add_plan(&self.connection, plan).map_err(|error| self.not_written(error))
    }

    /// Returns the circumstances that earlier runs noted, or null.
    ///
    /// # Errors
    /// If they cannot be read.
    pub(crate) fn environment(&self) -> Result<serde_json::Value, StoreError> {
        let text = manifest::get(&self.connection, ENVIRONMENT).map_err(|error| self.not_read(error))?;
        Ok(text.and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_default())
    }

    /// Returns the present date and time in UTC, as ISO 8601 writes it.
    ///
    /// # Errors
    /// If the database does not answer.
    pub(crate) fn now(&self) -> Result<String, StoreError> {
        let sql = "SELECT strftime('%Y-%m-%dT%H:%M:%SZ', 'now')";
        self.connection.query_row(sql, [], |row| row.get(0)).map_err(|error| self.not_read(error))
    }

    /// Returns the identity of the renderer whose images the rows of the file depend on.
    ///
    /// # Errors
    /// If it cannot be read.
    pub(crate) fn renderer(&self) -> Result<Option<String>, StoreError> {
        manifest::renderer(&self.connection).map_err(|error| self.not_read(error))
    }

    /// Stores the identity of the renderer for future rows.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn set_renderer(&self, identity: &str) -> Result<(), StoreError> {
        self.note(manifest::RENDERER, &identity.into())
    }

    /// Stores an episode. Once this returns, the row survives a crash of the process.
    ///
    /// # Errors
    /// If it cannot be written, or the file is no longer in its place.
    pub(crate) fn record(
        &mut self,
        key: EpisodeKey<'_>,
        seed: u64,
        outcome: &Outcome,
    ) -> Result<(), StoreError> {
        if !self.is_in_place() {
            return Err(StoreError::Gone { path: self.path.clone() });
        }
        let Condition { task, perturbation } = key.condition;
        let ledger = &outcome.ledger;
        let stored = self.connection.prepare_cached(schema::RECORD).and_then(|mut statement| {
            statement.execute(params![
                key.policy,
                task.name(),
                perturbation.name(),
                key.episode,
                // Episode seeds are below 2⁶³.
                seed.cast_signed(),
                outcome.steps,
                outcome.success_once,
                outcome.success_at_end,
                outcome.first_success_step,
                outcome.failed_predicate,
                format_fingerprint(outcome.fingerprint),
                outcome.error,
                ledger.physics_s,
                ledger.render_s,
                ledger.policy_s,
                ledger.wait_s,
                outcome.actions.as_ref().map(|actions| to_bytes(actions)),
            ])
        });
        stored.map(|_| ()).map_err(|error| self.not_written(error))
    }

    /// Returns the episodes that finished without an error.
    ///
    /// # Errors
    /// If they cannot be read.
    pub(crate) fn finished(&self) -> Result<FinishedEpisodes, StoreError> {
        let read = || {
            let mut statement = self.connection.prepare(schema::FINISHED)?;
            let keys =
                statement.query_map([], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?)))?;
            keys.collect::<Result<_, _>>().map(FinishedEpisodes)
        };
        read().map_err(|error| self.not_read(error))
    }

    /// Returns sums over the first `n_episodes` episodes of a policy under a condition.
    ///
    /// # Errors
    /// If they cannot be read.
    pub(crate) fn sums(
        &self,
        policy: &str,
        condition: Condition,
        n_episodes: u32,
    ) -> Result<CellSums, StoreError> {
        let Condition { task, perturbation } = condition;
        let read = || {
            let mut statement = self.connection.prepare_cached(schema::SUMS)?;
            statement.query_row(params![policy, task.name(), perturbation.name(), n_episodes], |row| {
                Ok(CellSums {
                    n: row.get(0)?,
                    success_once: row.get(1)?,
                    success_at_end: row.get(2)?,
                    steps: row.get::<_, i64>(3)?.unsigned_abs(),
                    errors: row.get(4)?,
                })
            })
        };
        read().map_err(|error| self.not_read(error))
    }

    /// Returns the episodes of a policy: condition, index, and success after any step, `None` if the episode
    /// could not be run.
    ///
    /// # Errors
    /// If they cannot be read.
    pub(crate) fn successes(&self, policy: &str) -> Result<Vec<(Condition, u32, Option<bool>)>, StoreError> {
        let read = || {
            let mut statement = self.connection.prepare(schema::SUCCESSES)?;
            let rows = statement.query_map([policy], |row| {
                let (task, perturbation): (String, String) = (row.get(0)?, row.get(1)?);
                Ok((task, perturbation, row.get(2)?, row.get(3)?))
            })?;
            rows.collect::<Result<Vec<_>, _>>()
        };
        let rows = read().map_err(|error| self.not_read(error))?;
        // Names that this version does not know belong to no condition of a run.
        let parsed = rows.into_iter().filter_map(|(task, perturbation, episode, success)| {
            Some((rows::parse_condition(&task, &perturbation).ok()?, episode, success))
        });
        Ok(parsed.collect())
    }

    fn not_read(&self, source: rusqlite::Error) -> StoreError {
        StoreError::Read { path: self.path.clone(), source }
    }

    fn not_written(&self, error: rusqlite::Error) -> StoreError {
        let cause = open::cause(&self.path, error);
        StoreError::Write { path: self.path.clone(), cause }
    }

    /// Returns `true` if the file at this path is still the one that is open.
    fn is_in_place(&self) -> bool {
        match (self.lock.metadata(), std::fs::metadata(&self.path)) {
            (Ok(open), Ok(named)) => (open.dev(), open.ino()) == (named.dev(), named.ino()),
            _ => false,
        }
    }
}

impl Drop for Results {
    fn drop(&mut self) {
        open::close(&self.connection);
    }
}

/// Returns the little-endian bytes of 32-bit patterns.
fn to_bytes(patterns: &[u32]) -> Vec<u8> {
    patterns.iter().flat_map(|pattern| pattern.to_le_bytes()).collect()
}

impl FinishedEpisodes {
    /// Returns `true` if this episode finished without an error.
    pub(crate) fn contains(&self, key: EpisodeKey<'_>) -> bool {
        let Condition { task, perturbation } = key.condition;
        let owned = (key.policy.to_owned(), task.name().to_owned(), perturbation.name(), key.episode);
        self.0.contains(&owned)
    }
}

#[cfg(test)]
mod tests;
