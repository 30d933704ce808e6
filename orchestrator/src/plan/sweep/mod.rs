//! The options of a sweep: an evaluation of policies under many conditions.

pub(crate) mod file;

use std::path::PathBuf;

use clap::Args;
use run_config::RunConfig;

use crate::selection::policy::NamedPolicy;
use crate::selection::selectors::{PerturbationSelector, TaskSelector};
use crate::statistics::Levels;

/// The options of a run that a sweep file can state as well. Paths are relative to the current folder.
#[derive(Args, Clone, Debug, PartialEq)]
pub(crate) struct SweepArgs {
    /// Policy and its name in the results (repeatable); SPEC is idle, random, expert, act:PATH,
    /// act-int8:PATH, pi05:PATH, pi05-int8:PATH, attach:NAME, openpi:URL, vla-eval:URL or lerobot-async:URL
    #[arg(long = "policy", value_name = "NAME=SPEC")]
    pub(crate) policies: Vec<NamedPolicy>,
    /// Tasks, comma-separated: names, all, single or bimanual [default: all]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = TaskSelector::PARSER,
        hide_possible_values = true)]
    pub(crate) tasks: Vec<TaskSelector>,
    /// Perturbations, comma-separated: names, names joined by + that act together, or all that apply
    /// [default: None]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = PerturbationSelector::PARSER,
        hide_possible_values = true)]
    pub(crate) perturbations: Vec<PerturbationSelector>,
    /// Episodes per policy, task and perturbation
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000),
        default_value_t = 10)]
    pub(crate) episodes: u32,
    /// Results file to create or resume
    #[arg(long, value_name = "FILE", default_value = "hypogeum.db")]
    pub(crate) db: PathBuf,
    /// End every cell as soon as the comparison of these two policies is decided in it; --episodes is
    /// then the most per cell
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    pub(crate) until_decided: Vec<String>,
    /// Smallest difference of success rates that matters to --until-decided
    #[arg(long, value_name = "M", value_parser = parse_margin, default_value_t = DEFAULT_LEVELS.margin)]
    pub(crate) margin: f64,
    /// Probability of a false decision of either kind in any cell of --until-decided
    #[arg(long, value_name = "P", value_parser = parse_level, default_value_t = DEFAULT_LEVELS.alpha)]
    pub(crate) alpha: f64,
    #[command(flatten)]
    pub(crate) config: RunConfig,
}

/// Probability of a false verdict and smallest difference of success rates that matters, by default.
pub(crate) const DEFAULT_LEVELS: Levels = Levels { alpha: 0.05, margin: 0.05 };

/// Parses a difference of success rates.
pub(crate) fn parse_margin(typed: &str) -> Result<f64, String> {
    let margin = typed.parse::<f64>().ok().filter(|number| *number > 0.0 && *number < 1.0);
    margin.ok_or_else(|| "expected a number between 0 and 1, for example 0.05".to_owned())
}

/// Parses a level. An interval at 1 − 2 alpha must exist.
pub(crate) fn parse_level(typed: &str) -> Result<f64, String> {
    let level = typed.parse::<f64>().ok().filter(|number| *number > 0.0 && *number < 0.5);
    level.ok_or_else(|| "expected a number between 0 and 0.5, for example 0.05".to_owned())
}

#[cfg(test)]
impl SweepArgs {
    /// Parses options separated by spaces.
    pub(crate) fn parse(options: &str) -> Result<Self, clap::Error> {
        use clap::FromArgMatches;
        let command = Self::augment_args(clap::Command::new("hypogeum run").no_binary_name(true));
        Self::from_arg_matches(&command.try_get_matches_from(options.split_whitespace())?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn option_names_are_sweep_file_keys() {
        let command = SweepArgs::augment_args(clap::Command::new("sweep"));
        for arg in command.get_arguments() {
            let (key, long) = (arg.get_id().as_str(), arg.get_long().unwrap());
            assert!(key == long.replace('-', "_") || (key, long) == ("policies", "policy"), "{key} {long}");
        }
    }
}
