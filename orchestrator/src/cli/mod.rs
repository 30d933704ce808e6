//! The command line. Every argument is parsed into its final type here and in the argument structs of the
//! commands.

pub(crate) mod evaluation_args;

use std::ffi::OsString;
use std::path::PathBuf;

use clap::parser::ValueSource;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

use crate::commands::child::{self, ChildArgs};
use crate::commands::completions::{self, CompletionsArgs};
use crate::commands::distribution::{merge, status, submit};
use crate::commands::evaluation::{demos, fps, plan, record, run};
use crate::commands::inspection::{checkpoint, doctor, show, tasks};
use crate::commands::results::{compare, pack, replay, report, verify};
use crate::console::exit::{ExitStatus, Failure};
use crate::plan::sweep::file;

/// Evaluates robot policies over the tasks and perturbations of COLOSSEUM V2.
#[derive(Debug, Parser)]
#[command(name = "hypogeum", version, disable_help_subcommand = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// Declares the subcommands: the help, the arguments and the function of each.
macro_rules! subcommands {
    ($($(#[$attribute:meta])* $name:ident($arguments:ty) => $function:expr,)*) => {
        /// A subcommand with its arguments.
        #[derive(Debug, Subcommand)]
        pub(crate) enum Command {
            $($(#[$attribute])* $name(Box<$arguments>),)*
        }

        impl Command {
            /// Runs the subcommand.
            pub(crate) fn run(&self) -> Result<ExitStatus, Failure> {
                match self {
                    $(Self::$name(arguments) => $function(arguments),)*
                }
            }
        }
    };
}

subcommands! {
    /// Evaluate policies; the same command again resumes an interrupted run
    Run(run::RunArgs) => run::run,
    /// Run a sweep as shards on many machines, by an existing scheduler or by ssh
    Submit(submit::SubmitArgs) => |arguments| submit::submit(arguments, &Cli::parse_run),
    /// Show the progress of the shards of a sweep
    Status(status::StatusArgs) => status::status,
    /// Compare two policies on matched episodes, or a policy with itself under perturbations
    Compare(compare::CompareArgs) => compare::compare,
    /// Join the results files of shards, and compare episodes that several of them have
    Merge(merge::MergeArgs) => merge::merge,
    /// Say how many episodes a comparison needs, and how long they take
    Plan(plan::PlanArgs) => plan::plan,
    /// List the task suite
    Tasks(tasks::TasksArgs) => tasks::tasks,
    /// Render the camera images at the start of episodes or along one, as a contact sheet or a movie
    Show(show::ShowArgs) => show::show,
    /// Write successful expert episodes as LeRobot datasets; the same command again resumes
    Demos(demos::DemosArgs) => demos::demos,
    /// Replay stored episodes and check that they are reproduced bit for bit
    Replay(replay::ReplayArgs) => replay::replay,
    /// Write a page with figures, comparisons and warnings, and the results as data
    Report(report::ReportArgs) => report::report,
    /// Check whether this machine is ready: shared memory, CPU, Vulkan, left-overs, Python
    Doctor(doctor::DoctorArgs) => doctor::doctor,
    /// Run episodes of a results file again and compare every column
    Verify(verify::VerifyArgs) => verify::verify,
    /// Put a results file and its checkpoints into one file, which `verify` runs again
    Pack(pack::PackArgs) => pack::pack,
    /// Measure speed over the number of envs, and where the time goes; the same command again resumes
    Fps(fps::FpsArgs) => fps::fps,
    /// Write a checkpoint with random weights, for measuring speed
    Checkpoint(checkpoint::CheckpointArgs) => checkpoint::checkpoint,
    /// Print a completion script for a shell
    Completions(CompletionsArgs) => |arguments| completions::completions(arguments, Cli::command()),
    /// Append episodes to a dataset (started by `hypogeum.record` of the Python package)
    #[command(hide = true)]
    Record(record::RecordArgs) => record::record,
    /// Simulate (started by `run`)
    #[command(hide = true)]
    Sim(ChildArgs) => child::sim,
    /// Answer a policy's queries (started by `run`)
    #[command(hide = true)]
    PolicyHost(ChildArgs) => child::policy_host,
    /// Free the shared memory of exited processes (started by `run`)
    #[command(hide = true)]
    Reap(ChildArgs) => child::reap,
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

    /// Parses arguments of `run`, as [`Self::parse_with_sweep_file`] does.
    ///
    /// # Errors
    /// As there.
    pub(crate) fn parse_run(arguments: &[String]) -> anyhow::Result<Box<run::RunArgs>> {
        let words = ["hypogeum", "run"].into_iter().chain(arguments.iter().map(String::as_str));
        let Self { command } = Self::parse_with_sweep_file(&words.map(OsString::from).collect::<Vec<_>>())?;
        let Command::Run(args) = command else { unreachable!("the subcommand is `run`") };
        Ok(args)
    }
}

#[cfg(test)]
mod tests {
    use std::ffi::OsStr;

    use run_config::Execution;

    use super::*;
    use crate::plan::sweep::SweepArgs;

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
        insta::assert_snapshot!(error("json = true\n"), @"the sweep file sweep.toml, line 1: unknown key `json`; expected one of policies, tasks, perturbations, episodes, db, until_decided, margin, alpha, seed, profile, strength, latency, control_mode, language, mode, execute, protocol, image_size, instructions, end, renderer, samples, policy_device, envs, threads, gpu, keep_actions, check_frames, python, trace");
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
