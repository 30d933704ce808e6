//! The command line. Every argument is parsed into its final type here and in the argument structs of the
//! commands.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::parser::ValueSource;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

use crate::commands::checkpoint::CheckpointArgs;
use crate::commands::child::ChildArgs;
use crate::commands::compare::CompareArgs;
use crate::commands::completions::CompletionsArgs;
use crate::commands::demos::DemosArgs;
use crate::commands::doctor::DoctorArgs;
use crate::commands::fps::FpsArgs;
use crate::commands::pack::PackArgs;
use crate::commands::plan::PlanArgs;
use crate::commands::replay::ReplayArgs;
use crate::commands::report::ReportArgs;
use crate::commands::run::RunArgs;
use crate::commands::show::ShowArgs;
use crate::commands::tasks::TasksArgs;
use crate::commands::verify::VerifyArgs;
use crate::sweep::file;

/// Evaluates robot policies over the tasks and perturbations of COLOSSEUM V2.
#[derive(Debug, Parser)]
#[command(name = "hypogeum", version, disable_help_subcommand = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// A subcommand with its arguments.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Evaluate policies; the same command again resumes an interrupted run
    Run(RunArgs),
    /// Compare two policies on matched episodes, or a policy with itself under perturbations
    Compare(CompareArgs),
    /// Say how many episodes a comparison needs, and how long they take
    Plan(PlanArgs),
    /// List the task suite
    Tasks(TasksArgs),
    /// Render the camera images at the start of episodes or along one, as a contact sheet or a movie
    Show(ShowArgs),
    /// Write successful expert episodes as LeRobot datasets; the same command again resumes
    Demos(DemosArgs),
    /// Replay stored episodes and check that they are reproduced bit for bit
    Replay(ReplayArgs),
    /// Write a page with figures, comparisons and warnings, and the results as data
    Report(ReportArgs),
    /// Check whether this machine is ready: shared memory, CPU, Vulkan, left-overs, Python
    Doctor(DoctorArgs),
    /// Run episodes of a results file again and compare every column
    Verify(VerifyArgs),
    /// Put a results file and its checkpoints into one file, which `verify` runs again
    Pack(PackArgs),
    /// Measure speed over the number of envs, and where the time goes; the same command again resumes
    Fps(FpsArgs),
    /// Write a checkpoint with random weights, for measuring speed
    Checkpoint(CheckpointArgs),
    /// Print a completion script for a shell
    Completions(CompletionsArgs),
    /// Simulate (started by `run`)
    #[command(hide = true)]
    Sim(ChildArgs),
    /// Answer a policy's queries (started by `run`)
    #[command(hide = true)]
    PolicyHost(ChildArgs),
    /// Free the shared memory of exited processes (started by `run`)
    #[command(hide = true)]
    Reap(ChildArgs),
}

impl Cli {
    /// Parses a whole command line, program name included. If `run` names a sweep file, merges its options
    /// in.
    ///
    /// # Errors
    /// If an argument is invalid ([`clap::Error`], which also carries help and version texts) or the sweep
    /// file is ([`SweepFileError`](file::SweepFileError)).
    pub(crate) fn parse_with_sweep_file(words: &[OsString]) -> anyhow::Result<Self> {
        let matches = Self::command().try_get_matches_from(words)?;
        let Some(("run", run)) = matches.subcommand() else { return Ok(Self::from_arg_matches(&matches)?) };
        let Some(path) = run.get_one::<PathBuf>("file") else { return Ok(Self::from_arg_matches(&matches)?) };
        let is_typed = |id: &str| run.value_source(id) == Some(ValueSource::CommandLine);
        let flags = file::flags(path, is_typed)?;
        // There are no options before the subcommand: the first two words are the program and `run`.
        let (command, typed) = words.split_at(2);
        let merged = command.iter().chain(&flags).chain(typed);
        Ok(Self::from_arg_matches(&Self::command().try_get_matches_from(merged)?)?)
    }
}

#[cfg(test)]
mod tests {
    use std::ffi::OsStr;

    use run_config::Execution;

    use super::*;
    use crate::sweep::SweepArgs;

    /// Parses `hypogeum run FILE ARGUMENTS`, where the file contains `text`.
    fn parse(text: &str, arguments: &str) -> Result<SweepArgs, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sweep.toml");
        std::fs::write(&path, text).unwrap();
        let words = ["hypogeum", "run"].map(OsStr::new).into_iter().chain([path.as_os_str()]);
        let words = words.chain(arguments.split_whitespace().map(OsStr::new)).map(OsStr::to_owned);
        let message = |error: anyhow::Error| {
            format!("{error:#}").replace(&path.display().to_string(), "sweep.toml").trim_end().to_owned()
        };
        let parsed = Cli::parse_with_sweep_file(&words.collect::<Vec<_>>()).map_err(message)?;
        let Command::Run(args) = parsed.command else { panic!("the command is `run`") };
        Ok(args.sweep)
    }

    #[test]
    fn command_definition_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn flags_override_the_sweep_file() {
        let text = r#"
            policies = ["idle", "mine=act:weights"]
            tasks = ["RaiseCube", "StackCube"]
            perturbations = "all"
            episodes = 100
            strength = 0.5
            samples = 4
            keep_actions = false
            control_mode = "pd_joint_pos"
        "#;
        let typed = "--policy idle --policy mine=act:weights --tasks RaiseCube,StackCube --perturbations all \
            --episodes 100 --strength 0.5 --samples 4 --keep-actions=false --control-mode pd_joint_pos";
        assert_eq!(parse(text, "").unwrap(), parse("", typed).unwrap());
        let both = parse(text, "--episodes 3 --tasks single --policy random --samples 1").unwrap();
        let typed = "--policy random --tasks single --perturbations all --episodes 3 --strength 0.5 --samples 1 \
            --keep-actions=false --control-mode pd_joint_pos";
        assert_eq!(both, parse("", typed).unwrap());
    }

    #[test]
    fn execute_default_follows_the_merged_mode() {
        let execute = |text, arguments| parse(text, arguments).unwrap().config.query.without_checkpoint();
        assert_eq!(execute("mode = \"ensemble\"", ""), Execution::ENSEMBLE);
        assert_eq!(execute("mode = \"ensemble\"", "--mode chunk"), Execution::chunk(30));
        assert_eq!(execute("execute = 7", ""), Execution::chunk(7));
    }

    #[test]
    fn file_errors_name_file_line_and_key() {
        let error = |text| parse(text, "").unwrap_err();
        insta::assert_snapshot!(error("\nepsiodes = 3\n"), @"the sweep file sweep.toml, line 2: unknown key `epsiodes`; did you mean episodes?");
        insta::assert_snapshot!(error("json = true\n"), @"the sweep file sweep.toml, line 1: unknown key `json`; expected one of policies, tasks, perturbations, episodes, db, until_decided, margin, alpha, seed, profile, strength, latency, control_mode, language, mode, execute, renderer, samples, policy_device, envs, threads, gpu, keep_actions, check_frames, trace");
        insta::assert_snapshot!(error("episodes = \"many\"\n"), @"the sweep file sweep.toml, line 1, key `episodes`: found `many`, expected a whole number");
        insta::assert_snapshot!(error("episodes = 0\n"), @"the sweep file sweep.toml, line 1, key `episodes`: 0 is not in 1..=1000000");
        insta::assert_snapshot!(error("episodes = [1, 2]\n"), @"the sweep file sweep.toml, line 1, key `episodes`: found [1, 2], expected one string or number");
        insta::assert_snapshot!(error("keep_actions = 1\n"), @"the sweep file sweep.toml, line 1, key `keep_actions`: unknown value `1`; expected one of true, false");
        insta::assert_snapshot!(error("tasks = 3\n"), @"the sweep file sweep.toml, line 1, key `tasks`: unknown task `3`; `hypogeum tasks --matrix` lists all names");
        insta::assert_snapshot!(error("tasks = [\n\"RaiseCube\",\n\"RiseCube\"]\n"), @"the sweep file sweep.toml, line 1, key `tasks`: unknown task `RiseCube`; did you mean RaiseCube or StackCube?");
        insta::assert_snapshot!(error("strength = 2\n"), @"the sweep file sweep.toml, line 1, key `strength`: strength is 2, expected a number from 0.001 to 1 (the benchmark's strength)");
        insta::assert_snapshot!(error("renderer = \"gpi\"\n"), @"the sweep file sweep.toml, line 1, key `renderer`: unknown value `gpi`; did you mean gpu?");
        insta::assert_snapshot!(error("samples = 3\n"), @"the sweep file sweep.toml, line 1, key `samples`: unknown value `3`; expected one of 1, 4");
        insta::assert_snapshot!(error("seed = 1\ntasks = \n"), @"the sweep file sweep.toml, line 2: it is not TOML: string values must be quoted, expected literal string");
        let absent = file::flags(std::path::Path::new("absent.toml"), |_| false).unwrap_err();
        insta::assert_snapshot!(format!("{:#}", anyhow::Error::from(absent)), @"failed to read the sweep file absent.toml: No such file or directory (os error 2)");
    }
}
