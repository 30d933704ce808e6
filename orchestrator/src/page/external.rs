//! Measurements from elsewhere that the page shows beside the results: success on hardware, and frames
//! per second.

use std::path::{Path, PathBuf};

use ipc_types::input;
use sim::TaskId;
use sim::perturb::Composition;
use thiserror::Error;

use crate::selection::{parse_perturbation, parse_task};

/// Optional measurements.
#[derive(Debug, Default)]
pub(crate) struct ExternalData {
    pub(crate) hardware: Option<HardwareTable>,
    pub(crate) fps: Option<FpsTable>,
}

/// Success rates on a real robot.
#[derive(Debug)]
pub(crate) struct HardwareTable {
    pub(crate) rows: Vec<HardwareRow>,
}

/// One row: a task under a perturbation.
#[derive(Debug)]
pub(crate) struct HardwareRow {
    pub(crate) task: TaskId,
    pub(crate) perturbation: Composition,
    /// In percent.
    pub(crate) success_percent: f64,
}

/// Frames per second by number of environments.
#[derive(Debug)]
pub(crate) struct FpsTable {
    /// (number of environments, frames per second).
    pub(crate) points: Vec<(f64, f64)>,
}

/// Errors that can occur while reading a table.
#[derive(Debug, Error)]
pub(crate) enum TableError {
    #[error("failed to read {}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{}: its first line is `{found}`, expected columns with {}", path.display(), expected.join(", "))]
    Columns { path: PathBuf, found: String, expected: Vec<&'static str> },
    #[error("{}, line {line}: {problem}", path.display())]
    Row { path: PathBuf, line: usize, problem: String },
}

/// Maximum size of a table in bytes.
const MAX_BYTES: u64 = 1 << 20;

impl HardwareTable {
    /// Reads a CSV file with the columns `task`, `perturbation` and `success_percent`, in any order.
    ///
    /// # Errors
    /// If the file cannot be read, lacks a column, or has an invalid value.
    pub(crate) fn read(path: &Path) -> Result<Self, TableError> {
        let rows = read_table(path, &["task", "perturbation", "success_percent"], |values| {
            Ok(HardwareRow {
                task: parse_task(values[0]).map_err(|error| error.to_string())?,
                perturbation: parse_perturbation(values[1]).map_err(|error| error.to_string())?,
                success_percent: number(values[2], 0.0, 100.0)?,
            })
        })?;
        Ok(Self { rows })
    }
}

impl FpsTable {
    /// Reads a CSV file with the original's columns `batch_size` and `frames_per_second`, in any order.
    ///
    /// # Errors
    /// If the file cannot be read, lacks a column, or has an invalid value.
    pub(crate) fn read(path: &Path) -> Result<Self, TableError> {
        let mut points = read_table(path, &["batch_size", "frames_per_second"], |values| {
            Ok((number(values[0], 1.0, 1e9)?, number(values[1], 1e-6, 1e12)?))
        })?;
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(Self { points })
    }
}

/// Reads the named columns of a CSV file without quoting, which these tables do not need.
fn read_table<T>(
    path: &Path,
    columns: &[&'static str],
    parse: impl Fn(&[&str]) -> Result<T, String>,
) -> Result<Vec<T>, TableError> {
    let read = |source| TableError::Read { path: path.into(), source };
    let size = std::fs::metadata(path).map_err(read)?.len();
    if size > MAX_BYTES {
        let problem = format!("the file has {size} bytes, expected at most {MAX_BYTES}");
        return Err(TableError::Row { path: path.into(), line: 1, problem });
    }
    let text = input::read_to_string(path).map_err(read)?;
    let header = text.lines().next().unwrap_or_default();
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let position = |column: &&str| names.iter().position(|name| name == column);
    let positions: Option<Vec<usize>> = columns.iter().map(position).collect();
    let positions = positions.ok_or_else(|| TableError::Columns {
        path: path.into(),
        found: header.to_owned(),
        expected: columns.to_vec(),
    })?;
    let rows = text.lines().enumerate().skip(1).filter(|(_, line)| !line.trim().is_empty());
    let row = |(idx, line): (usize, &str)| {
        let failed = |problem| TableError::Row { path: path.into(), line: idx + 1, problem };
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        if cells.len() != names.len() {
            return Err(failed(format!("found {} values, expected {}", cells.len(), names.len())));
        }
        let values: Vec<&str> = positions.iter().map(|position| cells[*position]).collect();
        parse(&values).map_err(failed)
    };
    rows.map(row).collect()
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
    fn errors_name_line_and_value() {
        insta::assert_snapshot!(read("task,percent\n").unwrap_err(), @"hardware.csv: its first line is `task,percent`, expected columns with task, perturbation, success_percent");
        insta::assert_snapshot!(read("task,perturbation,success_percent\nRaiseCube,None,142\n").unwrap_err(), @"hardware.csv, line 2: found `142`, expected a number from 0 to 100");
        insta::assert_snapshot!(read("task,perturbation,success_percent\nRiseCube,None,42\n").unwrap_err(), @"hardware.csv, line 2: unknown task `RiseCube`; did you mean RaiseCube or StackCube?");
        insta::assert_snapshot!(read("task,perturbation,success_percent\nRaiseCube,None\n").unwrap_err(), @"hardware.csv, line 2: found 2 values, expected 3");
    }
}
