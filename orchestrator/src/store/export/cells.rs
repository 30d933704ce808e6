//! One row per cell, as the columns of a Parquet file.

use crate::store::parquet_table::{Cells, NamedCells};
use crate::store::results::Column;
use crate::study::analysis::CellSummary;

/// Returns the columns. Rates and their intervals are fractions, and NaN without episodes; times are sums
/// over the episodes.
pub(crate) fn columns(cells: &[CellSummary]) -> Vec<NamedCells> {
    type Of<T> = fn(&CellSummary) -> T;
    let texts = |name: &str, of: Of<String>| (name.to_owned(), Cells::Text(cells.iter().map(of).collect()));
    let counts = |name: &str, of: Of<u64>| {
        (name.to_owned(), Cells::Int(cells.iter().map(|cell| of(cell).cast_signed()).collect()))
    };
    let numbers = |name: &str, of: Of<Option<f64>>| {
        let number = |cell| of(cell).unwrap_or(f64::NAN) as f32;
        (name.to_owned(), Cells::Float(cells.iter().map(number).collect()))
    };
    let mut columns = vec![
        texts(Column::Policy.name(), |cell| cell.policy.clone()),
        texts(Column::Task.name(), |cell| cell.condition.task.name().to_owned()),
        texts(Column::Perturbation.name(), |cell| cell.condition.perturbation.name()),
        counts("episodes", |cell| cell.rate.n.into()),
        counts("successes", |cell| cell.rate.successes.into()),
        numbers("rate", |cell| cell.rate.fraction()),
        numbers("low", |cell| cell.interval.map(|[low, _]| low)),
        numbers("high", |cell| cell.interval.map(|[_, high]| high)),
        counts(Column::SuccessOnce.name(), |cell| cell.success_once.into()),
        counts(Column::SuccessAtEnd.name(), |cell| cell.success_at_end.into()),
        counts("errors", |cell| cell.errors.into()),
        counts(Column::Steps.name(), |cell| cell.steps),
    ];
    for (idx, column) in Column::TIMES.iter().enumerate() {
        let seconds = cells.iter().map(|cell| cell.times_s[idx] as f32).collect();
        columns.push((column.name().to_owned(), Cells::Float(seconds)));
    }
    columns
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use parquet::file::reader::{FileReader, SerializedFileReader};
    use sim::{Perturbation, TaskId};

    use super::*;
    use crate::selection::condition::Condition;
    use crate::store::parquet_table::ParquetTable;
    use crate::study::analysis::Rate;

    #[test]
    fn row_has_every_value_of_its_cell() {
        let cell = |n, interval| CellSummary {
            policy: "act".to_owned(),
            condition: Condition { task: TaskId::RaiseCube, perturbation: Perturbation::LightColor.into() },
            rate: Rate { successes: n / 2, n },
            interval,
            success_once: n / 2,
            success_at_end: n / 4,
            steps: 92 * u64::from(n),
            errors: 3,
            first_success_steps: Vec::new(),
            failed_predicates: std::collections::BTreeMap::new(),
            times_s: [1.0, 2.0, 4.0, 0.5],
        };
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("cells.parquet");
        let cells = [cell(8, Some([0.25, 0.75])), cell(0, None)];
        ParquetTable::write(&path, columns(&cells), None).unwrap();
        let reader = SerializedFileReader::new(File::open(&path).unwrap()).unwrap();
        let rows: Vec<String> =
            reader.get_row_iter(None).unwrap().map(|row| row.unwrap().to_string()).collect();
        insta::assert_snapshot!(rows.join("\n"), @r#"
        {policy: "act", task: "RaiseCube", perturbation: "Light-Color", episodes: 8, successes: 4, rate: 0.5, low: 0.25, high: 0.75, success_once: 4, success_at_end: 2, errors: 3, steps: 736, physics_s: 1.0, render_s: 2.0, policy_s: 4.0, wait_s: 0.5}
        {policy: "act", task: "RaiseCube", perturbation: "Light-Color", episodes: 0, successes: 0, rate: NaN, low: NaN, high: NaN, success_once: 0, success_at_end: 0, errors: 3, steps: 0, physics_s: 1.0, render_s: 2.0, policy_s: 4.0, wait_s: 0.5}
        "#);
    }
}
