//! Reading of the values of a feature in a data file.

use std::fs::File;
use std::ops::Range;
use std::path::Path;

use anyhow::{Context, bail, ensure};
use parquet::basic::Type as Physical;
use parquet::column::reader::{ColumnReader, get_typed_column_reader};
use parquet::data_type::{DataType, FloatType, Int64Type};
use parquet::file::reader::{FileReader, SerializedFileReader};

/// Rows that are decoded at a time.
const RECORDS_PER_READ: usize = 1024;

/// Reads the values of a feature in some row groups of a data file.
///
/// # Errors
/// If the file has no such rows, or no numbers of that name.
pub(crate) fn read_values(path: &Path, groups: Range<usize>, feature: &str) -> anyhow::Result<Vec<f32>> {
    let reader = SerializedFileReader::new(File::open(path)?)?;
    let n_groups = reader.num_row_groups();
    ensure!(groups.end <= n_groups, "it has {n_groups} row groups, expected at least {}", groups.end);
    let mut values = Vec::new();
    for group_idx in groups {
        let group = reader.get_row_group(group_idx)?;
        let columns = group.metadata().columns();
        let is_wanted = |parts: &[String]| parts.first().is_some_and(|first| first == feature);
        let idx = columns.iter().position(|column| is_wanted(column.column_path().parts()));
        let idx = idx.with_context(|| format!("it has no `{feature}`"))?;
        let column = group.get_column_reader(idx)?;
        match columns[idx].column_type() {
            Physical::FLOAT => values.extend(read_column::<FloatType>(column)?),
            Physical::INT64 => values.extend(read_column::<Int64Type>(column)?.iter().map(|&x| x as f32)),
            other => bail!("`{feature}` has the type {other}, expected FLOAT or INT64"),
        }
    }
    Ok(values)
}

fn read_column<T: DataType>(column: ColumnReader) -> anyhow::Result<Vec<T::T>> {
    let mut column = get_typed_column_reader::<T>(column);
    let (mut values, mut definitions, mut repeats) = (Vec::new(), Vec::new(), Vec::new());
    loop {
        let before = values.len();
        column.read_records(RECORDS_PER_READ, Some(&mut definitions), Some(&mut repeats), &mut values)?;
        if values.len() == before {
            return Ok(values);
        }
    }
}
