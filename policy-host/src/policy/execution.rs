//! Execution of a checkpoint's chunks: as the user says, or else as the checkpoint does.

use ipc_types::layout::MAX_HORIZON;
use run_config::{Execution, QueryMode, QueryOptions};
use thiserror::Error;

use super::DEFAULT_ENSEMBLE_DECAY;

/// A checkpoint's own settings for the use of its chunks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChunkSettings {
    /// Rows of a chunk.
    pub horizon: usize,
    /// Rows to execute before the next query (`n_action_steps`), if the checkpoint says so.
    pub execute: Option<usize>,
    /// Decay of the temporal ensemble's weights (`temporal_ensemble_coeff`), if it is to be used.
    pub ensemble_decay: Option<f64>,
}

/// A checkpoint wants to execute more rows than an answer holds.
#[derive(Debug, Error, PartialEq, Eq)]
#[error(
    "`n_action_steps` is {found}, but an answer holds at most {MAX_HORIZON} rows: add --execute {MAX_HORIZON} (or less) to \
     query more often than it was trained for"
)]
pub struct TooManyRowsError {
    found: usize,
}

impl ChunkSettings {
    /// Returns the execution of the chunks, and a sentence that says who chose it.
    ///
    /// # Errors
    /// If the checkpoint decides and wants more than [`MAX_HORIZON`] rows.
    pub fn resolve(self, requested: QueryOptions) -> Result<(Execution, String), TooManyRowsError> {
        let wants_ensemble = self.ensemble_decay.is_some() && requested == QueryOptions::default();
        if wants_ensemble || requested.mode == Some(QueryMode::Ensemble) {
            return Ok((Execution::ENSEMBLE, self.ensemble_note(wants_ensemble)));
        }
        let horizon = self.horizon.min(MAX_HORIZON) as u32;
        // One row per query is what an ensemble needs, not what a chunk was trained for.
        let own = self.execute.filter(|_| self.ensemble_decay.is_none());
        let (wanted, reason) = match (requested.execute, own) {
            (Some(rows), Some(own)) if rows as usize == own => {
                (rows, "as trained (`n_action_steps`)".to_owned())
            }
            (Some(rows), Some(own)) => (rows, format!("--execute; its own `n_action_steps` is {own}")),
            (Some(rows), None) => (rows, "--execute".to_owned()),
            (None, Some(own)) if own > MAX_HORIZON => return Err(TooManyRowsError { found: own }),
            (None, Some(own)) => (own as u32, "as trained (`n_action_steps`)".to_owned()),
            (None, None) => (Execution::DEFAULT_ROWS, "the default".to_owned()),
        };
        let reason = match self.ensemble_decay {
            Some(decay) => format!("{reason}; its own `temporal_ensemble_coeff` of {decay} is not used"),
            None => reason,
        };
        let execute = wanted.min(horizon);
        let reason = if wanted > horizon && requested.execute.is_some() {
            format!("{reason}, but {wanted} is more than a chunk has")
        } else {
            reason
        };
        let note = format!("executes {execute} of {} rows per query ({reason})", self.horizon);
        Ok((Execution::chunk(execute), note))
    }

    fn ensemble_note(self, is_own: bool) -> String {
        let reason = match (self.ensemble_decay, is_own) {
            (Some(decay), true) => format!("as trained (`temporal_ensemble_coeff` {decay})"),
            (Some(decay), false) => format!("--mode ensemble, `temporal_ensemble_coeff` {decay}"),
            (None, _) => {
                let own = self.execute.map(|rows| format!("; its own `n_action_steps` is {rows}"));
                format!(
                    "--mode ensemble, coefficient {DEFAULT_ENSEMBLE_DECAY} by default{}",
                    own.unwrap_or_default()
                )
            }
        };
        format!("queried at every control step, predictions averaged ({reason})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn settings(horizon: usize, execute: Option<usize>, ensemble_decay: Option<f64>) -> ChunkSettings {
        ChunkSettings { horizon, execute, ensemble_decay }
    }

    #[test]
    fn command_wins_over_checkpoint_over_default() {
        let execution = |settings: ChunkSettings, mode, execute| {
            settings.resolve(QueryOptions { mode, execute }).map(|(execution, _)| execution)
        };
        let (chunk, ensemble) = (Some(QueryMode::Chunk), Some(QueryMode::Ensemble));
        let trained = settings(100, Some(100), None);
        assert_eq!(execution(trained, None, None), Ok(Execution::chunk(100)));
        assert_eq!(execution(trained, None, Some(7)), Ok(Execution::chunk(7)));
        assert_eq!(execution(trained, ensemble, None), Ok(Execution::ENSEMBLE));
        assert_eq!(execution(settings(30, None, None), None, None), Ok(Execution::chunk(30)));
        assert_eq!(execution(settings(16, None, None), None, None), Ok(Execution::chunk(16)));
        assert_eq!(execution(settings(30, None, None), None, Some(50)), Ok(Execution::chunk(30)));
        let averaged = settings(70, Some(1), Some(0.05));
        assert_eq!(execution(averaged, None, None), Ok(Execution::ENSEMBLE));
        assert_eq!(execution(averaged, chunk, None), Ok(Execution::chunk(30)));
        assert_eq!(execution(averaged, None, Some(15)), Ok(Execution::chunk(15)));
        let long = settings(200, Some(150), None);
        assert_eq!(execution(long, None, None), Err(TooManyRowsError { found: 150 }));
        assert_eq!(execution(long, None, Some(100)), Ok(Execution::chunk(100)));
    }

    #[test]
    fn notes_name_who_chose() {
        let note = |settings: ChunkSettings, mode, execute| {
            settings.resolve(QueryOptions { mode, execute }).unwrap().1
        };
        let cases = [
            (note(settings(100, Some(100), None), None, None), "100 of 100 rows per query (as trained"),
            (note(settings(30, Some(30), None), None, Some(50)), "30 of 30 rows per query (--execute"),
            (note(settings(30, Some(30), None), None, Some(50)), "50 is more than a chunk has"),
            (
                note(settings(70, Some(1), Some(0.05)), None, None),
                "as trained (`temporal_ensemble_coeff` 0.05",
            ),
            (
                note(settings(70, Some(1), Some(0.05)), None, Some(20)),
                "`temporal_ensemble_coeff` of 0.05 is not used",
            ),
            (
                note(settings(30, Some(15), None), Some(QueryMode::Ensemble), None),
                "its own `n_action_steps` is 15",
            ),
            (note(settings(16, None, None), None, None), "16 of 16 rows per query (the default)"),
        ];
        for (note, part) in cases {
            assert!(note.contains(part), "{note} lacks {part}");
        }
    }
}
