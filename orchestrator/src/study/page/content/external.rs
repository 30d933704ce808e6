//! Measurements from elsewhere that the page shows beside the results: success on hardware, and frames
//! per second.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use run_config::input;
use serde::Serialize;
use thiserror::Error;

use crate::selection::condition::Condition;
use crate::selection::selectors::{parse_perturbation, parse_task};

/// Optional measurements.
#[derive(Debug, Default, Serialize)]
pub(crate) struct ExternalData {
    pub(crate) hardware: Option<HardwareTable>,
    pub(crate) fps: Vec<FpsTable>,
}

/// Success rates on a real robot.
#[derive(Debug, Serialize)]
pub(crate) struct HardwareTable {
    pub(crate) rows: Vec<HardwareRow>,
}

/// One row: a task under a perturbation.
#[derive(Debug, Serialize)]
pub(crate) struct HardwareRow {
    #[serde(flatten)]
    pub(crate) condition: Condition,
    /// In percent.
    pub(crate) success_percent: f64,
}

/// Frames per second by number of environments.
#[derive(Debug, Serialize)]
pub(crate) struct FpsTable {
    /// Name of the simulator or policy.
    pub(crate) name: String,
    /// Number of environments, frames per second.
    pub(crate) points: Vec<[f64; 2]>,
}

/// Errors that can occur while reading a table.
#[derive(Debug, Error)]
pub(crate) enum TableError {
    #[error("failed to read {}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{}: its first line is `{found}`, expected columns with {}", path.display(), expected.join(", "))]
    Columns { path: PathBuf, found: String, expected: Vec<&'static str> },
    #[error("{}, line {line}: {problem}", path.display())]
    Row { path: PathBuf, line: u64, problem: String },
}

/// Maximum size of a table in bytes.
const MAX_BYTES: u64 = 1 << 20;

impl HardwareTable {
    /// Reads a CSV file with the columns `task`, `perturbation` and `success_percent`, in any order.
    ///
    /// # Errors
    /// If the file cannot be read, lacks a column, has an invalid value or the same row twice, or contains
    /// fractions instead of percent.
    pub(crate) fn read(path: &Path) -> Result<Self, TableError> {
        let rows = read_table(path, &["task", "perturbation", "success_percent"], |values| {
            let task = parse_task(values[0]).map_err(|error| error.to_string())?;
            let perturbation = parse_perturbation(values[1]).map_err(|error| error.to_string())?;
            let success_percent = number(values[2], 0.0, 100.0)?;
            Ok(HardwareRow { condition: Condition { task, perturbation }, success_percent })
        })?;
        let failed = |line, problem| TableError::Row { path: path.into(), line, problem };
        let mut lines: HashMap<Condition, u64> = HashMap::new();
        for (line, HardwareRow { condition, .. }) in &rows {
            if let Some(first) = lines.insert(*condition, *line) {
                let (task, perturbation) = (condition.task.name(), condition.perturbation.name());
                return Err(failed(*line, format!("{task} {perturbation} is already in line {first}")));
            }
        }
        let largest =
            rows.iter().map(|(line, row)| (row.success_percent, *line)).max_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((percent, line)) = largest.filter(|(percent, _)| *percent > 0.0 && *percent <= 1.0) {
            let problem = format!("no value is above {percent}: these look like fractions, expected percent");
            return Err(failed(line, problem));
        }
        Ok(Self { rows: rows.into_iter().map(|(_, row)| row).collect() })
    }
}

impl FpsTable {
    /// Reads a CSV file with the original's columns `batch_size` and `frames_per_second`, in any order.
    ///
    /// # Errors
    /// If the file cannot be read, lacks a column, or has an invalid value.
    pub(crate) fn read(name: &str, path: &Path) -> Result<Self, TableError> {
        let rows = read_table(path, &["batch_size", "frames_per_second"], |values| {
            Ok([number(values[0], 1.0, 1e9)?, number(values[1], 1e-6, 1e12)?])
        })?;
        let mut points: Vec<[f64; 2]> = rows.into_iter().map(|(_, point)| point).collect();
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        Ok(Self { name: name.to_owned(), points })
    }
}

/// Reads the named columns of a CSV file. Returns the rows with their lines.
fn read_table<T>(
    path: &Path,
    columns: &[&'static str],
    parse: impl Fn(&[&str]) -> Result<T, String>,
) -> Result<Vec<(u64, T)>, TableError> {
    let read = |source| TableError::Read { path: path.into(), source };
    let size = std::fs::metadata(path).map_err(read)?.len();
    if size > MAX_BYTES {
        let problem = format!("the file has {size} bytes, expected at most {MAX_BYTES}");
        return Err(TableError::Row { path: path.into(), line: 1, problem });
    }
    let text = input::read_to_string(path).map_err(read)?;
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    let invalid = |error: csv::Error| {
        let line = error.position().map_or(1, csv::Position::line);
        let problem = match error.kind() {
            csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
                format!("found {len} values, expected {expected_len}")
            }
            _ => error.to_string(),
        };
        TableError::Row { path: path.into(), line, problem }
    };
    let names = reader.headers().map_err(invalid)?.clone();
    let position = |column: &&str| names.iter().position(|name| name == *column);
    let positions: Option<Vec<usize>> = columns.iter().map(position).collect();
    let positions = positions.ok_or_else(|| TableError::Columns {
        path: path.into(),
        found: names.iter().collect::<Vec<_>>().join(","),
        expected: columns.to_vec(),
    })?;
    let row = |record: Result<csv::StringRecord, csv::Error>| {
        let record = record.map_err(invalid)?;
        let line = record.position().map_or(1, csv::Position::line);
        let values: Vec<&str> = positions.iter().map(|position| &record[*position]).collect();
        let failed = |problem| TableError::Row { path: path.into(), line, problem };
        Ok((line, parse(&values).map_err(failed)?))
    };
    reader.records().map(row).collect()
}

fn number(text: &str, low: f64, high: f64) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| (low..=high).contains(number));
    number.ok_or_else(|| format!("found `{text}`, expected a number from {low} to {high}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<HardwareTable, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hardware.csv");
        std::fs::write(&path, text).unwrap();
        HardwareTable::read(&path)
            .map_err(|error| error.to_string().replace(&path.display().to_string(), "hardware.csv"))
    }

    #[test]
    fn columns_may_come_in_any_order() {
        let table = read("success_percent,task,note,perturbation\n42.5,RaiseCube,x,MO-Size\n\n").unwrap();
        assert_eq!((table.rows.len(), table.rows[0].success_percent), (1, 42.5));
    }

    #[test]
    fn files_of_spreadsheets_are_read() {
        let text =
            "\u{feff}\"task\",\"perturbation\",\"success_percent\"\r\n\"RaiseCube\",\"None\",\"42.5\"\r\n";
        assert_eq!(read(text).unwrap().rows[0].success_percent, 42.5);
    }

    #[test]
    fn errors_name_line_and_value() {
        insta::assert_snapshot!(read("task,percent\n").unwrap_err(), @"hardware.csv: its first line is `task,percent`, expected columns with task, perturbation, success_percent");
        insta::assert_snapshot!(read("task,perturbation,success_percent\nRaiseCube,None,142\n").unwrap_err(), @"hardware.csv, line 2: found `142`, expected a number from 0 to 100");
        insta::assert_snapshot!(read("task,perturbation,success_percent\nRiseCube,None,42\n").unwrap_err(), @"hardware.csv, line 2: unknown task `RiseCube`; did you mean RaiseCube or StackCube?");
        insta::assert_snapshot!(read("task,perturbation,success_percent\nRaiseCube,None\n").unwrap_err(), @"hardware.csv, line 2: found 2 values, expected 3");
        let table = |rows: &str| read(&format!("task,perturbation,success_percent\n{rows}"));
        insta::assert_snapshot!(table("RaiseCube,None,42\nRaiseCube,All,4\nRaiseCube,None,43\n").unwrap_err(), @"hardware.csv, line 4: RaiseCube None is already in line 2");
        insta::assert_snapshot!(table("RaiseCube,None,0.42\nRaiseCube,All,0\n").unwrap_err(), @"hardware.csv, line 2: no value is above 0.42: these look like fractions, expected percent");
    }
}
