//! What the benchmarks share: their arguments, a table of figures that is printed and may be written as CSV, peers to be
//! measured against, and what the processor could do at best.

mod fma;
mod peer;

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::{Context, Result, bail};

pub use fma::peak_gflop_per_s;
pub use peer::Peer;

/// Figures of one benchmark. CSV columns: bench, case, value, unit, note.
#[derive(Debug)]
pub struct Report {
    bench: &'static str,
    csv_file: Option<PathBuf>,
    csv: String,
}

impl Report {
    /// Reads `--csv FILE` from the command line.
    ///
    /// # Errors
    /// On any other argument.
    pub fn from_args(bench: &'static str) -> Result<Self> {
        Self::with_options(bench, "", |_, _| Ok(false))
    }

    /// Reads `--csv FILE` and options of the benchmark's own, which `usage` lists: `take` gets each with its value and says
    /// whether it knows it.
    ///
    /// # Errors
    /// On an argument that is not known, or that `take` refuses.
    pub fn with_options(
        bench: &'static str,
        usage: &str,
        mut take: impl FnMut(&str, &str) -> Result<bool>,
    ) -> Result<Self> {
        let mut csv_file = None;
        let mut arguments = std::env::args().skip(1);
        while let Some(argument) = arguments.next() {
            // What cargo itself adds.
            if argument == "--bench" {
                continue;
            }
            let value = arguments.next().with_context(|| format!("{argument} needs a value"))?;
            if argument == "--csv" {
                csv_file = Some(value.into());
            } else if !take(&argument, &value)? {
                bail!("unknown argument {argument}: expected {usage}--csv FILE");
            }
        }
        Ok(Self { bench, csv_file, csv: String::from("bench,case,value,unit,note\n") })
    }

    /// Adds one figure; the note must not hold a comma.
    pub fn add(&mut self, case: &str, value: f64, unit: &str, note: &str) {
        debug_assert!(!note.contains(','), "the note is a CSV field");
        writeln!(self.csv, "{},{case},{value:.3},{unit},{note}", self.bench).expect("a String takes all");
    }

    /// Writes the CSV file, if one was asked for.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(self) -> Result<()> {
        self.csv_file.map_or(Ok(()), |path| {
            std::fs::write(&path, self.csv).with_context(|| format!("write {}", path.display()))
        })
    }
}

/// The middle value, or the upper of two.
///
/// # Panics
/// If there is none.
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
