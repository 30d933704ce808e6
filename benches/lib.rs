//! Shared code of the benchmarks: command-line parsing, CSV reports, and peer processes to compare with.

mod device;
mod peer;

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};

pub use device::{BenchDevice, DEVICE_USAGE};
pub use peer::Peer;

/// Measurements of one benchmark. CSV columns: bench, case, value, unit, note.
#[derive(Debug)]
pub struct Report {
    bench: &'static str,
    csv_file: Option<PathBuf>,
    csv: String,
}

impl Report {
    /// Parses `--csv FILE` from the command line.
    ///
    /// # Errors
    /// If there is any other argument.
    pub fn from_args(bench: &'static str) -> Result<Self> {
        Self::with_options(bench, "", |_, _| Ok(false))
    }

    /// Parses `--csv FILE` and the benchmark's own options. `parse` receives each option with its value and
    /// returns `Ok(false)` if it does not know the option; `usage` lists the options for error messages.
    ///
    /// # Errors
    /// If an option is unknown, lacks a value, or is rejected by `parse`.
    pub fn with_options(
        bench: &'static str,
        usage: &str,
        mut parse: impl FnMut(&str, &str) -> Result<bool>,
    ) -> Result<Self> {
        let mut csv_file = None;
        let mut arguments = std::env::args().skip(1);
        while let Some(argument) = arguments.next() {
            // Cargo itself adds this flag.
            if argument == "--bench" {
                continue;
            }
            let value = arguments.next().with_context(|| format!("{argument} needs a value"))?;
            if argument == "--csv" {
                csv_file = Some(value.into());
            } else if !parse(&argument, &value)? {
                bail!("unknown argument {argument}: expected {usage}--csv FILE");
            }
        }
        Ok(Self { bench, csv_file, csv: String::from("bench,case,value,unit,note\n") })
    }

    /// Appends one measurement. `note` must not contain commas.
    pub fn add(&mut self, case: &str, value: f64, unit: &str, note: &str) {
        debug_assert!(!note.contains(','), "a comma in the note would split the CSV field");
        writeln!(self.csv, "{},{case},{value:.3},{unit},{note}", self.bench)
            .expect("writing to a String cannot fail");
    }

    /// Writes the CSV file if `--csv` was given.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(self) -> Result<()> {
        self.csv_file.map_or(Ok(()), |path| {
            std::fs::write(&path, self.csv).with_context(|| format!("write {}", path.display()))
        })
    }
}

/// Sorts the values and returns their median: the middle value, or the upper one of the two middle values.
///
/// # Panics
/// If `values` is empty.
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
