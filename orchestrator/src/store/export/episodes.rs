//! One row per episode as a Parquet file.

use std::path::Path;

use crate::store::parquet_table::{Cells, ParquetTable};
use crate::store::results::{Column, EpisodeRow, ResultsFile, Value, Values};
use crate::study::analysis::{Evaluation, RowIdx};

/// Rows per row group.
const ROWS_PER_GROUP: usize = 1 << 17;

/// Writes the file.
///
/// # Errors
/// If it cannot be written.
pub(crate) fn write(evaluation: &Evaluation, path: &Path) -> anyhow::Result<()> {
    let mut table = ParquetTable::create(path, &RowGroup::new().named(), None)?;
    for policy in &evaluation.policies {
        let cells = evaluation.conditions(policy);
        let rows: Vec<RowIdx> = cells.iter().flat_map(|(_, rows)| rows.iter().copied()).collect();
        for rows in rows.chunks(ROWS_PER_GROUP) {
            let mut group = RowGroup::new();
            for &idx in rows {
                group.push(&policy.name, &evaluation.files[idx.file_idx as usize], evaluation.row(idx));
            }
            table.push(group.named())?;
        }
    }
    table.finish()
}

/// The columns of one row group.
struct RowGroup(Vec<Cells>);

/// Returns the columns of the file: those of a results file before the checksum.
fn columns() -> impl Iterator<Item = Column> {
    Column::checked().iter().copied()
}

impl RowGroup {
    fn new() -> Self {
        let empty = |column: Column| match column.values() {
            Values::Text | Values::Sealed => Cells::Text(Vec::new()),
            Values::UpTo(_) | Values::UpToOrNull(_) => Cells::Int(Vec::new()),
            Values::Seconds => Cells::Float(Vec::new()),
        };
        Self(columns().map(empty).collect())
    }

    /// Adds a row of `policy`, as the evaluation calls it. Columns have no nulls: a missing text is empty,
    /// and a missing number −1.
    fn push(&mut self, policy: &str, file: &ResultsFile, row: &EpisodeRow) {
        for (cells, column) in self.0.iter_mut().zip(columns()) {
            match (cells, file.value(row, column)) {
                (Cells::Text(texts), _) if column == Column::Policy => texts.push(policy.to_owned()),
                (Cells::Text(texts), Value::Text(text)) => texts.push(text),
                (Cells::Text(texts), _) => texts.push(String::new()),
                (Cells::Int(numbers), Value::Integer(number)) => numbers.push(number),
                (Cells::Int(numbers), _) => numbers.push(-1),
                (Cells::Float(numbers), Value::Real(number)) => numbers.push(number as f32),
                (cells, value) => unreachable!("{cells:?} take {value:?}"),
            }
        }
    }

    /// Returns the columns with their names.
    fn named(self) -> Vec<(String, Cells)> {
        columns().map(|column| column.name().to_owned()).zip(self.0).collect()
    }
}
