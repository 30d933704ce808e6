//! An open results file: stores finished episodes and notes, and answers questions on those it has.

use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use rusqlite::types::{Value, ValueRef};
use rusqlite::{Connection, params, params_from_iter};
use serde::de::DeserializeOwned;
use sim::serve::protocol::Outcome;

use crate::plan::RunPlan;
use crate::selection::condition::{Condition, parse_condition};
use crate::store::results::columns::{Column, EpisodeKey};
use crate::store::results::error::{ResultsFileError, StoreError, cause};
use crate::store::results::manifest::Manifest;
use crate::store::results::{integrity, manifest, open, schema};

/// An open results file.
#[derive(Debug)]
pub(crate) struct Results {
    pub(crate) connection: Connection,
    path: PathBuf,
    // Excludes a second writer until the connection is closed. SQLite's own POSIX locks are lost when any
    // descriptor of the file is closed, so this descriptor must outlive the connection.
    lock: File,
}

/// The episodes of a plan that a results file has: indices of policy and condition, and of the episode.
#[derive(Clone, Debug, Default)]
pub(crate) struct FinishedEpisodes(HashSet<(u32, u32, u32)>);

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

    /// Stores a value that results do not depend on, replacing an earlier one with the same key.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn set_metadata(&self, key: &str, value: &serde_json::Value) -> Result<(), StoreError> {
        manifest::put(&self.connection, key, value).map_err(|error| self.not_written(error))
    }

    /// Adds the plan of a run to those of the file, so that missing episodes can be noticed.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn add_plan(&self, plan: &RunPlan) -> Result<(), StoreError> {
        manifest::add_plan(&self.connection, plan).map_err(|error| self.not_written(error))
    }

    /// Returns a value that was stored with [`Self::set_metadata`]; `None` if there is none of this type.
    ///
    /// # Errors
    /// If it cannot be read.
    pub(crate) fn metadata<T: DeserializeOwned>(&self, key: &str) -> Result<Option<T>, StoreError> {
        let text = manifest::get(&self.connection, key).map_err(|error| self.not_read(error))?;
        Ok(text.and_then(|text| serde_json::from_str(&text).ok()))
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
        self.set_metadata(manifest::RENDERER, &identity.into())
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
        let of_outcome = |column: &Column| column.of_outcome(&key, seed, outcome);
        let mut values: Vec<Value> = Column::checked().iter().map(of_outcome).collect();
        values.push(integrity::checksum(values.iter().map(ValueRef::from)).into());
        let actions = outcome.actions.as_ref();
        values.push(actions.map(|actions| integrity::sealed_actions(to_bytes(actions), seed)).into());
        let stored = self
            .connection
            .prepare_cached(&schema::record())
            .and_then(|mut statement| statement.execute(params_from_iter(values)));
        stored.map(|_| ()).map_err(|error| self.not_written(error))
    }

    /// Returns the episodes of a plan that finished without an error.
    ///
    /// # Errors
    /// If they cannot be read.
    pub(crate) fn finished(&self, plan: &RunPlan) -> Result<FinishedEpisodes, StoreError> {
        let names = plan.policies.iter().map(|policy| policy.name.as_str());
        let policies: HashMap<&str, u32> = names.zip(0..).collect();
        let names = plan.conditions.iter().map(|it| (it.task.name().to_owned(), it.perturbation.name()));
        let conditions: HashMap<(String, String), u32> = names.zip(0..).collect();
        let read = || {
            let mut finished = HashSet::new();
            let mut statement = self.connection.prepare(&schema::finished())?;
            let mut rows = statement.query([])?;
            // Rows are sorted by condition, so the names of one condition are looked up once.
            let mut names = (String::new(), String::new());
            let mut condition = None;
            while let Some(row) = rows.next()? {
                let (task, perturbation) = (
                    row.get_ref(Column::Task as usize)?.as_str()?,
                    row.get_ref(Column::Perturbation as usize)?.as_str()?,
                );
                if (names.0.as_str(), names.1.as_str()) != (task, perturbation) {
                    names = (task.to_owned(), perturbation.to_owned());
                    condition = conditions.get(&names);
                }
                let episode = row.get(Column::Episode as usize)?;
                let policy = policies.get(row.get_ref(Column::Policy as usize)?.as_str()?);
                if let (Some(policy), Some(condition)) = (policy, condition)
                    && episode < plan.episodes
                {
                    finished.insert((*policy, *condition, episode));
                }
            }
            Ok(FinishedEpisodes(finished))
        };
        read().map_err(|error| self.not_read(error))
    }

    /// Returns how many episodes finished without an error.
    ///
    /// # Errors
    /// If they cannot be counted.
    pub(crate) fn n_finished(&self) -> Result<u64, StoreError> {
        let count = self.connection.query_row(&schema::n_finished(), [], |row| row.get::<_, i64>(0));
        count.map(i64::unsigned_abs).map_err(|error| self.not_read(error))
    }

    /// Checks that at least `expected` episodes have finished without an error.
    ///
    /// # Errors
    /// If there are fewer, or they cannot be counted.
    pub(crate) fn check_n_finished(&self, expected: u64) -> Result<(), StoreError> {
        match expected.saturating_sub(self.n_finished()?) {
            0 => Ok(()),
            n => Err(StoreError::Vanished { path: self.path.clone(), n }),
        }
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
            let mut statement = self.connection.prepare_cached(&schema::sums())?;
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
            let mut statement = self.connection.prepare(&schema::successes())?;
            let rows = statement.query_map([policy], |row| {
                let (task, perturbation): (String, String) = (row.get(0)?, row.get(1)?);
                Ok((task, perturbation, row.get(2)?, row.get(3)?))
            })?;
            rows.collect::<Result<Vec<_>, _>>()
        };
        let rows = read().map_err(|error| self.not_read(error))?;
        // Names that this version does not know belong to no condition of a run.
        let parsed = rows.into_iter().filter_map(|(task, perturbation, episode, success)| {
            Some((parse_condition(&task, &perturbation).ok()?, episode, success))
        });
        Ok(parsed.collect())
    }

    fn not_read(&self, source: rusqlite::Error) -> StoreError {
        StoreError::Read { path: self.path.clone(), source }
    }

    fn not_written(&self, error: rusqlite::Error) -> StoreError {
        let cause = cause(&self.path, error);
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

impl FinishedEpisodes {
    /// Returns `true` if this episode finished without an error.
    pub(crate) fn contains(&self, policy_idx: usize, condition_idx: usize, episode: u32) -> bool {
        self.0.contains(&(policy_idx as u32, condition_idx as u32, episode))
    }

    /// Returns the number of episodes.
    pub(crate) fn len(&self) -> u64 {
        self.0.len() as u64
    }
}

/// Returns the little-endian bytes of 32-bit patterns.
fn to_bytes(patterns: &[u32]) -> Vec<u8> {
    patterns.iter().flat_map(|pattern| pattern.to_le_bytes()).collect()
}
