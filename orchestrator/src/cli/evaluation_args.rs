//! Command-line arguments that name the results to analyse, shared by `compare` and `report`.

use std::path::PathBuf;

use anyhow::anyhow;
use clap::Args;

use crate::console::exit::{Failure, OrUser};
use crate::console::output::print_message;
use crate::plan::sweep::{DEFAULT_LEVELS, parse_level, parse_margin};
use crate::statistics::Levels;
use crate::store::shards::results_files;
use crate::study::analysis::{Evaluation, Metric, read_files};

/// The results to analyse, and the level of the conclusions.
#[derive(Args, Clone, Debug)]
pub(crate) struct EvaluationArgs {
    /// Results files of `run`, packages of `pack`, or folders of shards
    #[arg(value_name = "RESULTS.db|FILE.zip|DIR", required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// Options that may differ between the files although results depend on them, such as `latency`; `seed`
    /// pools the episodes of several seeds, and `policy` tells policies apart by their files although their
    /// names and checkpoints agree
    #[arg(long, value_name = "KEY,…", value_delimiter = ',')]
    pub(crate) across: Vec<String>,
    /// Success that is compared
    #[arg(long, value_enum, default_value_t)]
    pub(crate) metric: Metric,
    /// Smallest difference of success rates that matters [default: 0.05, or that of --until-decided]
    #[arg(long, value_name = "M", value_parser = parse_margin)]
    pub(crate) margin: Option<f64>,
    /// Probability of a false verdict of either kind in a table [default: 0.05, or that of --until-decided]
    #[arg(long, value_name = "P", value_parser = parse_level)]
    pub(crate) alpha: Option<f64>,
}

impl EvaluationArgs {
    /// Reads and merges the files, and tells of any that a run is still writing to.
    pub(crate) fn read(&self) -> Result<Evaluation, Failure> {
        let files = read_files(&results_files(&self.files).or_user()?).or_user()?;
        for file in files.iter().filter(|file| file.in_use) {
            print_message(&format!(
                "{}: a run is writing to it; this covers the {} episodes finished so far",
                file.path.display(),
                file.rows.len()
            ));
        }
        Evaluation::new(files, &self.across).or_user()
    }

    /// Returns the level and the margin of verdicts: those of the rule that ended cells early, if one did.
    pub(crate) fn levels(&self, evaluation: &Evaluation) -> Result<Levels, Failure> {
        let rules =
            || evaluation.files.iter().filter_map(|file| Some((&file.path, file.stopping.as_ref()?.levels)));
        let default = rules().next().map_or(DEFAULT_LEVELS, |(_, levels)| levels);
        let levels = Levels {
            alpha: self.alpha.unwrap_or(default.alpha),
            margin: self.margin.unwrap_or(default.margin),
        };
        if let Some((path, rule)) = rules().find(|(_, rule)| *rule != levels) {
            let Levels { alpha, margin } = rule;
            return Err(anyhow!(
                "{}: cells ended when they were decided with --margin {margin} --alpha {alpha}; this analysis uses --margin {} --alpha {}",
                path.display(),
                levels.margin,
                levels.alpha
            ))
            .or_user();
        }
        Ok(levels)
    }
}
