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
pub(crate) use self::error::{ResultsFileError, StoreError, not_used, not_written};
pub(crate) use self::file::{EpisodeRow, ResultsFile};
pub(crate) use self::gaps::{Gap, gap_lines, gaps, planned_cells};
pub(crate) use self::integrity::{row_finding, shown};
pub(crate) use self::manifest::{
    DifferingEntry, ENVIRONMENT, Manifest, PLANS, SHARD, STOPPING, StoredPlan, defaults, differences, option,
    policy_key, put,
};
pub(crate) use self::open::{
    copy_snapshot, copy_without_times, create_for_bulk, n_finished_in, open_for_replacement, open_unchecked,
};
pub(crate) use self::recorded::RecordedEpisodes;
pub(crate) use self::rows::read_manifest;
pub(crate) use self::schema::{COUNT, insert, whole_rows};

#[cfg(test)]
#[path = "../../../tests/results/mod.rs"]
mod tests;
