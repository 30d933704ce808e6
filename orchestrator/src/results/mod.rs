//! The results file: SQLite, written by one orchestrator at a time, one transaction per finished episode.
//!
//! It owns table `episodes` (one complete row per finished episode), table `manifest` (what the rows depend on) and what
//! resuming means. It never overwrites a row, unless that row holds an error.

mod kept;
mod manifest;
mod open;
mod schema;

use std::collections::BTreeSet;
use std::fs::File;
use std::path::{Path, PathBuf};

use rusqlite::{Connection, params};
use sim::serve::protocol::Outcome;
use thiserror::Error;

pub(crate) use self::kept::Kept;
pub(crate) use self::manifest::Manifest;
pub(crate) use self::open::OpenError;
use crate::plan::Condition;

/// An open results file.
#[derive(Debug)]
pub(crate) struct Results {
    connection: Connection,
    path: PathBuf,
    // Held, against a second writer, until the connection is closed: SQLite's own locks are lost when any descriptor of
    // the file is closed, so this one must outlive them.
    _lock: File,
}

/// What identifies an episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Key<'a> {
    /// Name of the policy.
    pub(crate) policy: &'a str,
    pub(crate) condition: Condition,
    /// Index of the episode.
    pub(crate) episode: u32,
}

/// Episodes that need not run again.
#[derive(Clone, Debug, Default)]
pub(crate) struct Finished(BTreeSet<(String, String, String, u32)>);

/// Sums over the episodes of one policy under one condition.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct CellSums {
    /// Episodes that ran to their end.
    pub(crate) n: u32,
    /// Of these, with success after any step.
    pub(crate) success_once: u32,
    /// Of these, with success after the last step.
    pub(crate) success_at_end: u32,
    /// Control steps of these.
    pub(crate) steps: u64,
    /// Episodes that ended with an error; not in `n`.
    pub(crate) errors: u32,
}

/// A results file that stopped working.
#[derive(Debug, Error)]
#[error("failed to {action} {}: {source}", path.display())]
pub(crate) struct StoreError {
    action: &'static str,
    path: PathBuf,
    source: rusqlite::Error,
}

impl Results {
    /// Opens `path`, or creates it, for a run with this manifest.
    ///
    /// # Errors
    /// If it is not a results file of this version, holds rows that depend on something else than this manifest says, is
    /// in use, or cannot be written.
    pub(crate) fn open(path: &Path, manifest: &Manifest) -> Result<Self, OpenError> {
        let (connection, lock) = open::open(path)?;
        manifest::reconcile(&connection, path, manifest)?;
        Ok(Self { connection, path: path.into(), _lock: lock })
    }

    /// Notes something results do not depend on, for readers of the file; replaces an earlier note.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn note(&self, key: &str, value: &serde_json::Value) -> Result<(), StoreError> {
        manifest::put(&self.connection, key, value).map_err(|source| self.failed("write to", source))
    }

    /// Identity of the renderer that the images behind the file's rows come from.
    ///
    /// # Errors
    /// If it cannot be read.
    pub(crate) fn drawn_with(&self) -> Result<Option<String>, StoreError> {
        manifest::drawn_with(&self.connection).map_err(|source| self.failed("read", source))
    }

    /// Notes it for rows to come.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn draw_with(&self, identity: &str) -> Result<(), StoreError> {
        self.note(manifest::RENDERER, &identity.into())
    }

    /// Stores an episode. When this returns, the row survives the end of the process.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn record(&mut self, key: Key<'_>, seed: u64, outcome: &Outcome) -> Result<(), StoreError> {
        let Condition { task, perturbation } = key.condition;
        let ledger = &outcome.ledger;
        let stored = self.connection.prepare_cached(schema::RECORD).and_then(|mut statement| {
            statement.execute(params![
                key.policy,
                task.name(),
                perturbation.name(),
                key.episode,
                // Episode seeds lie below 2⁶³.
                seed.cast_signed(),
                outcome.steps,
                outcome.success_once,
                outcome.success_at_end,
                outcome.first_success_step,
                outcome.failed_predicate,
                crate::replay::shown(outcome.fingerprint),
                outcome.error,
                ledger.physics_s,
                ledger.render_s,
                ledger.policy_s,
                ledger.wait_s,
                outcome.actions.as_ref().map(|actions| to_bytes(actions)),
            ])
        });
        stored.map(|_| ()).map_err(|source| self.failed("write to", source))
    }

    /// Episodes that ran to their end.
    ///
    /// # Errors
    /// If they cannot be read.
    pub(crate) fn finished(&self) -> Result<Finished, StoreError> {
        let read = || {
            let mut statement = self.connection.prepare(schema::FINISHED)?;
            let keys =
                statement.query_map([], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?)))?;
            keys.collect::<Result<_, _>>().map(Finished)
        };
        read().map_err(|source| self.failed("read", source))
    }

    /// Sums over the first `n_episodes` episodes of a policy under a condition.
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
        read().map_err(|source| self.failed("read", source))
    }

    fn failed(&self, action: &'static str, source: rusqlite::Error) -> StoreError {
        StoreError { action, path: self.path.clone(), source }
    }
}

/// Little-endian bytes of 32-bit patterns.
fn to_bytes(patterns: &[u32]) -> Vec<u8> {
    patterns.iter().flat_map(|pattern| pattern.to_le_bytes()).collect()
}

impl Finished {
    /// Whether this episode ran to its end.
    pub(crate) fn contains(&self, key: Key<'_>) -> bool {
        let Condition { task, perturbation } = key.condition;
        let owned = (key.policy.to_owned(), task.name().to_owned(), perturbation.name(), key.episode);
        self.0.contains(&owned)
    }
}

#[cfg(test)]
mod tests;
