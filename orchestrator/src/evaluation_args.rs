//! Command-line arguments that name the results to analyse, shared by `compare` and `report`.

use std::path::PathBuf;

use clap::Args;

use crate::analysis::{Evaluation, Metric, read_files};
use crate::exit::{Failure, OrUser};
use crate::output::print_message;
use crate::statistics::Levels;
use crate::sweep::{DEFAULT_LEVEL, DEFAULT_MARGIN, parse_level, parse_margin};

/// The results to analyse, and the level of the conclusions.
#[derive(Args, Clone, Debug)]
pub(crate) struct EvaluationArgs {
    /// Results files of `run`
    #[arg(value_name = "RESULTS.db", required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// Option that may differ between the files although results depend on it, such as `latency`
    /// (repeatable)
    #[arg(long, value_name = "KEY")]
    pub(crate) across: Vec<String>,
    /// Success that is compared
    #[arg(long, value_enum, default_value_t)]
    pub(crate) metric: Metric,
    /// Smallest difference of success rates that matters
    #[arg(long, value_name = "M", value_parser = parse_margin, default_value_t = DEFAULT_MARGIN)]
    pub(crate) margin: f64,
    /// Probability of a false verdict
    #[arg(long, value_name = "P", value_parser = parse_level, default_value_t = DEFAULT_LEVEL)]
    pub(crate) alpha: f64,
}

impl EvaluationArgs {
    /// Reads and merges the files, and tells of any that a run is still writing to.
    pub(crate) fn read(&self) -> Result<Evaluation, Failure> {
        let files = read_files(&self.files).or_user()?;
        for file in files.iter().filter(|file| file.in_use) {
            print_message(&format!(
                "{}: a run is writing to it; this covers the {} episodes finished so far",
                file.path.display(),
                file.rows.len()
            ));
        }
        Evaluation::new(files, &self.across).or_user()
    }

    pub(crate) fn levels(&self) -> Levels {
        Levels { alpha: self.alpha, margin: self.margin }
    }
}
