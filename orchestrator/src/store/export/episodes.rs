//! One row per episode as a Parquet file.

use std::path::Path;

use crate::store::parquet_table::{Cells, Column, ParquetTable};
use crate::store::stored_episode::format_fingerprint;
use crate::study::analysis::Evaluation;

/// Rows per row group.
const ROWS_PER_GROUP: usize = 1 << 17;

/// Writes the file under a temporary name first.
///
/// # Errors
/// If it cannot be written.
pub(crate) fn write(evaluation: &Evaluation, path: &Path) -> anyhow::Result<()> {
    let partial = path.with_extension("partial");
    let mut columns = Columns::default();
    let mut table = ParquetTable::create(&partial, &Columns::default().take(), None)?;
    for policy in &evaluation.policies {
        for (condition, rows) in evaluation.conditions(policy) {
            let (task, perturbation) = (condition.task.name(), condition.perturbation.name());
            for &idx in rows {
                columns.push(evaluation, idx, [&policy.name, task, &perturbation]);
                if columns.len() == ROWS_PER_GROUP {
                    table.push(columns.take())?;
                }
            }
        }
    }
    if columns.len() > 0 {
        table.push(columns.take())?;
    }
    table.finish()?;
    std::fs::rename(&partial, path)?;
    Ok(())
}

/// The columns of one row group.
#[derive(Default)]
struct Columns {
    texts: [Vec<String>; 6],
    numbers: [Vec<i64>; 6],
    times: [Vec<f32>; 4],
}

const TEXTS: [&str; 6] = ["policy", "task", "perturbation", "failed_predicate", "fingerprint", "error"];
/// `first_success_step` is −1 without success, because columns have no nulls.
const NUMBERS: [&str; 6] =
    ["episode", "seed", "steps", "success_once", "success_at_end", "first_success_step"];
const TIMES: [&str; 4] = ["physics_s", "render_s", "policy_s", "wait_s"];

impl Columns {
    fn len(&self) -> usize {
        self.numbers[0].len()
    }

    fn push(&mut self, evaluation: &Evaluation, idx: crate::study::analysis::RowIdx, names: [&str; 3]) {
        let row = evaluation.row(idx);
        let file = &evaluation.files[idx.file_idx as usize];
        let text = |idx: Option<u32>| idx.map_or_else(String::new, |idx| file.text(idx).to_owned());
        let [policy, task, perturbation] = names.map(str::to_owned);
        let fingerprint = row.fingerprint.map_or_else(String::new, format_fingerprint);
        let texts = [policy, task, perturbation, text(row.failed_predicate), fingerprint, text(row.error)];
        self.texts.iter_mut().zip(texts).for_each(|(column, text)| column.push(text));
        let numbers = [
            i64::from(row.episode),
            row.seed.cast_signed(),
            i64::from(row.steps),
            i64::from(row.success_once),
            i64::from(row.success_at_end),
            row.first_success_step.map_or(-1, i64::from),
        ];
        self.numbers.iter_mut().zip(numbers).for_each(|(column, number)| column.push(number));
        self.times.iter_mut().zip(row.times_s).for_each(|(column, seconds)| column.push(seconds));
    }

    /// Moves the rows out.
    fn take(&mut self) -> Vec<Column> {
        let Self { texts, numbers, times } = std::mem::take(self);
        let texts = TEXTS.into_iter().zip(texts).map(|(name, cells)| (name.to_owned(), Cells::Text(cells)));
        let numbers =
            NUMBERS.into_iter().zip(numbers).map(|(name, cells)| (name.to_owned(), Cells::Int(cells)));
        let times = TIMES.into_iter().zip(times).map(|(name, cells)| (name.to_owned(), Cells::Float(cells)));
        texts.chain(numbers).chain(times).collect()
    }
}
