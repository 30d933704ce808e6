//! The results file: SQLite, written by one orchestrator at a time, one transaction per finished episode.
//!
//! It owns the table `episodes` (one complete row per finished episode), the table `manifest` (the
//! configuration that the rows depend on) and the rules of resuming. It never overwrites a row, unless that
//! row has an error.

mod columns;
mod episodes;
mod error;
mod file;
mod gaps;
mod integrity;
mod manifest;
mod open;
mod recorded;
mod rows;
mod schema;
#[cfg(any(test, feature = "fuzzing"))]
#[path = "../../../tests/sealing/mod.rs"]
pub(crate) mod sealing;

pub(crate) use rusqlite::types::Value;

pub(crate) use self::columns::{Column, EpisodeKey, Values};
pub(crate) use self::episodes::{CellSums, FinishedEpisodes, Results};
pub(crate) use self::error::StoreError;
pub(crate) use self::file::{EpisodeRow, ResultsFile};
pub(crate) use self::gaps::{Gap, gaps};
pub(crate) use self::manifest::{ENVIRONMENT, Manifest, PLANS, STOPPING};
pub(crate) use self::open::copy_snapshot;
pub(crate) use self::recorded::RecordedEpisodes;

#[cfg(test)]
#[path = "../../../tests/results/mod.rs"]
mod tests;
