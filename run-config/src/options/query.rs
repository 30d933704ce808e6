//! Use of the action chunks that a policy predicts: what the user asks for, and what a policy does.

use clap::{Args, value_parser};
use serde::{Deserialize, Serialize};

use ipc_types::layout::MAX_HORIZON;

use super::choices::QueryMode;

/// Options of how policies are queried. Without them, a checkpoint's own settings decide. A results file
/// stores the [`Execution`] that results from them as a part of each policy's identity.
#[derive(Args, Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct QueryOptions {
    /// Use of the action chunks that a policy predicts [default: the checkpoint's own, or chunk]
    #[arg(long, value_enum, ignore_case = true)]
    pub mode: Option<QueryMode>,
    /// Rows of each action chunk to execute before the next query; always 1 in ensemble mode [default: the
    /// checkpoint's own, or 30]
    #[arg(long, value_name = "M", value_parser = value_parser!(u32).range(1..=MAX_HORIZON as i64))]
    pub execute: Option<u32>,
}

/// The use of a policy's chunks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Execution {
    /// Use of its chunks.
    pub mode: QueryMode,
    /// Rows of each chunk that are executed before the next query; 1 in ensemble mode.
    pub execute: u32,
}

impl Execution {
    /// A query and an average at every control step.
    pub const ENSEMBLE: Self = Self { mode: QueryMode::Ensemble, execute: 1 };
    /// Rows that are executed where neither the user nor a checkpoint says how many.
    pub const DEFAULT_ROWS: u32 = 30;

    /// Returns the execution of chunks by `execute` rows.
    #[must_use]
    pub const fn chunk(execute: u32) -> Self {
        Self { mode: QueryMode::Chunk, execute }
    }
}

impl QueryOptions {
    /// Returns the execution of a policy that has no preference.
    #[must_use]
    pub fn without_checkpoint(self) -> Execution {
        match self.mode {
            Some(QueryMode::Ensemble) => Execution::ENSEMBLE,
            Some(QueryMode::Chunk) | None => {
                Execution::chunk(self.execute.unwrap_or(Execution::DEFAULT_ROWS))
            }
        }
    }
}
