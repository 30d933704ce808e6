//! The command line. Every argument is parsed into its final type here.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::parser::ValueSource;
use clap::{Args, CommandFactory, FromArgMatches, Parser, Subcommand};
use ipc_types::run_config::{Profile, Strength};
use ipc_types::{ControlMode, RunConfig};
use sim::TaskId;
use sim::perturb::Composition;
use sim::show::{Actor, HighResScene, ViewMode};

use crate::checkpoint::Size;
use crate::demos::ImageFormat;
use crate::names::{NameParser, UnknownName, pick};
use crate::policy::NamedPolicy;
use crate::selection::{PERTURBATION_PARSER, PerturbationSelector, TASK_PARSER, TaskSelector};
use crate::sweep_file;

/// Evaluates robot policies over the tasks and perturbations of COLOSSEUM V2.
#[derive(Debug, Parser)]
#[command(name = "hypogeum", version, disable_help_subcommand = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Evaluate policies; the same command again resumes an interrupted run
    Run(RunArgs),
    /// List the task suite
    Tasks(TasksArgs),
    /// Render the camera images at the start of episodes or along one, as a contact sheet or a movie
    Show(ShowArgs),
    /// Write successful expert episodes as LeRobot datasets; the same command again resumes an interrupted one
    Demos(DemosArgs),
    /// Replay stored episodes and check that they are reproduced bit for bit
    Replay(ReplayArgs),
    /// Write a randomly initialised ACT checkpoint, for measuring speed
    Checkpoint(CheckpointArgs),
    /// Simulate (started by `run`)
    #[command(hide = true)]
    Sim(ChildArgs),
    /// Answer a policy's queries (started by `run`)
    #[command(hide = true)]
    PolicyHost(ChildArgs),
}

/// Arguments of `run`.
#[derive(Debug, Args)]
pub(crate) struct RunArgs {
    /// Sweep file: the options below as TOML keys, for example `control_mode` for --control-mode and the list `policies` for
    /// --policy. Options on the command line override those of the file
    #[arg(value_name = "SWEEP.toml")]
    pub(crate) file: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) sweep: SweepArgs,
    /// Print one JSON object instead of a table
    #[arg(long)]
    pub(crate) json: bool,
    /// Show no progress
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// The options of a run that a sweep file can state as well. Paths are relative to the current folder.
#[derive(Args, Clone, Debug, PartialEq)]
pub(crate) struct SweepArgs {
    /// Policy and its name in the results (repeatable); SPEC is idle, random, expert, act:PATH, act-int8:PATH or attach:NAME
    #[arg(long = "policy", value_name = "NAME=SPEC")]
    pub(crate) policies: Vec<NamedPolicy>,
    /// Tasks, comma-separated: names, all, single or bimanual [default: all]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = TaskSelector::PARSER,
        hide_possible_values = true)]
    pub(crate) tasks: Vec<TaskSelector>,
    /// Perturbations, comma-separated: names, names joined by + that act together, or all that apply [default: None]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = PerturbationSelector::PARSER,
        hide_possible_values = true)]
    pub(crate) perturbations: Vec<PerturbationSelector>,
    /// Episodes per policy, task and perturbation
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000), default_value_t = 10)]
    pub(crate) episodes: u32,
    /// Results file
    #[arg(long, value_name = "FILE", default_value = "hypogeum.db")]
    pub(crate) db: PathBuf,
    #[command(flatten)]
    pub(crate) config: RunConfig,
}

/// Arguments of `tasks`.
#[derive(Debug, Args)]
pub(crate) struct TasksArgs {
    /// Show which perturbations apply to which task, and the reasons for those that do not
    #[arg(long)]
    pub(crate) matrix: bool,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

/// Arguments of `show`.
#[derive(Debug, Args)]
pub(crate) struct ShowArgs {
    /// Task
    #[arg(value_parser = TASK_PARSER, hide_possible_values = true)]
    pub(crate) task: TaskId,
    /// Perturbation, several joined by + that act together, or all: one row for each that applies to the task
    #[arg(long, default_value = "None", value_parser = PerturbationSelector::PARSER, hide_possible_values = true)]
    pub(crate) perturbation: PerturbationSelector,
    /// Strength of the perturbation, above 0 and at most 1
    #[arg(long, value_name = "X", default_value_t = Strength::FULL)]
    pub(crate) strength: Strength,
    /// Suite seed, as in `run`
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Index of the first episode under that seed
    #[arg(long, default_value_t = 0)]
    pub(crate) episode: u32,
    /// Show the starts of this many successive episodes, one row each
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64),
        conflicts_with_all = ["policy", "movie"])]
    pub(crate) episodes: u32,
    /// Reading of the benchmark where its paper and its released code disagree
    #[arg(long, value_enum, ignore_case = true, default_value_t = Profile::Strict)]
    pub(crate) profile: Profile,
    /// View to render. rgb: the images that policies receive; depth: log depth in viridis, near bright, 0.05 to 4 m at most,
    /// with the range on stdout; seg: one colour per body, arm, table, floor and walls, with the legend on stdout. Black is
    /// background
    #[arg(long, value_name = "VIEW", default_value = "rgb", value_parser = VIEW_PARSER)]
    pub(crate) what: ViewMode,
    /// Let this policy act and show the start, the middle and the success (or end) of the episode
    #[arg(long, value_name = "SPEC", value_parser = SCRIPT_PARSER)]
    pub(crate) policy: Option<Actor>,
    /// Write the whole episode, 20 control steps per second, as .png or .apng (lossless) or .gif (small); the expert acts
    /// unless --policy is given
    #[arg(long, value_name = "FILE")]
    pub(crate) movie: Option<PathBuf>,
    /// Contact sheet to write [default: TASK.png]
    #[arg(short, long, value_name = "FILE.png", conflicts_with = "movie")]
    pub(crate) output: Option<PathBuf>,
}

/// Arguments of `demos`.
#[derive(Debug, Args)]
pub(crate) struct DemosArgs {
    /// Folder to write to; it receives one dataset in each of single/ and bimanual/
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: PathBuf,
    /// Tasks, comma-separated: names, all, single or bimanual
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "all", value_parser = TaskSelector::PARSER,
        hide_possible_values = true)]
    pub(crate) tasks: Vec<TaskSelector>,
    /// Successful episodes per task
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub(crate) episodes: u32,
    /// Suite seed; use another one than for evaluation, where the default is 0
    #[arg(long, value_name = "S", default_value_t = 1000)]
    pub(crate) seed: u64,
    /// Perturbation, or several joined by +
    #[arg(long, value_name = "NAME", default_value = "None", value_parser = PERTURBATION_PARSER,
        hide_possible_values = true)]
    pub(crate) perturbation: Composition,
    /// Strength of the perturbation, above 0 and at most 1
    #[arg(long, value_name = "X", default_value_t = Strength::FULL)]
    pub(crate) strength: Strength,
    /// Reading of the benchmark where its paper and its released code disagree
    #[arg(long, value_enum, ignore_case = true, default_value_t = Profile::Strict)]
    pub(crate) profile: Profile,
    /// Control mode in which single-arm episodes are recorded
    #[arg(long, value_name = "MODE", default_value = "pd_ee_delta_pose", value_parser = DEMO_MODE_PARSER)]
    pub(crate) control_mode: ControlMode,
    /// Image format
    #[arg(long, value_name = "FORMAT", value_enum, ignore_case = true, default_value_t = ImageFormat::Jpeg)]
    pub(crate) images: ImageFormat,
    /// Worker threads [default: one per core]
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub(crate) threads: Option<u32>,
    /// Show no progress
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// Arguments of `replay`.
#[derive(Debug, Args)]
pub(crate) struct ReplayArgs {
    /// Dataset, which is single/ or bimanual/ in a folder that `demos` wrote, or a results file of `run --keep-actions`
    #[arg(value_name = "DATASET|FILE.db")]
    pub(crate) source: PathBuf,
    /// Episodes, comma-separated indices into the source [default: all, or the first for a movie]
    #[arg(long, value_name = "LIST", value_delimiter = ',', conflicts_with_all = ["policy", "task", "perturbation"])]
    pub(crate) episodes: Vec<usize>,
    /// Only episodes of this policy, by its name in the results
    #[arg(long, value_name = "NAME")]
    pub(crate) policy: Option<String>,
    /// Only episodes of this task
    #[arg(long, value_name = "NAME", value_parser = TASK_PARSER, hide_possible_values = true)]
    pub(crate) task: Option<TaskId>,
    /// Only episodes under this perturbation, or under these joined by +
    #[arg(long, value_name = "NAME", value_parser = PERTURBATION_PARSER, hide_possible_values = true)]
    pub(crate) perturbation: Option<Composition>,
    /// Replay a random sample of this many of them
    #[arg(long, value_name = "N", conflicts_with_all = ["episodes", "movie"])]
    pub(crate) sample: Option<usize>,
    /// Seed of the sample
    #[arg(long, value_name = "S", default_value_t = 0, requires = "sample")]
    pub(crate) seed: u64,
    /// Write the first of them as a movie of all cameras: .png or .apng (lossless) or .gif (small)
    #[arg(long, value_name = "FILE")]
    pub(crate) movie: Option<PathBuf>,
    /// Movie resolution as a multiple, 1 to 8, of the policy's: 224 pixels per edge for external cameras, 128 for hand cameras
    #[arg(long, value_name = "N", default_value_t = 1, requires = "movie", value_parser = parse_scale)]
    pub(crate) scale: usize,
    /// Show no progress
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// Arguments of `checkpoint`.
#[derive(Debug, Args)]
pub(crate) struct CheckpointArgs {
    /// Folder to write to; created if absent
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: PathBuf,
    /// Size of the network
    #[arg(long, value_enum, ignore_case = true, default_value_t = Size::Full)]
    pub(crate) size: Size,
    /// Seed of the weights
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
}

/// Arguments of the child processes.
#[derive(Debug, Args)]
pub(crate) struct ChildArgs {
    /// The child's whole configuration as JSON
    #[arg(long, value_name = "JSON")]
    pub(crate) config: String,
}

const VIEW_PARSER: NameParser<ViewMode, UnknownName> = NameParser {
    parse: |typed| pick("view", typed, &ViewMode::ALL, ViewMode::name),
    names: || ViewMode::ALL.map(ViewMode::name).to_vec(),
};

const SCRIPT_PARSER: NameParser<Actor, UnknownName> = NameParser {
    parse: |typed| pick("policy to show", typed, &Actor::ALL, Actor::name),
    names: || Actor::ALL.map(Actor::name).to_vec(),
};

/// Control modes in which an expert's episode can be recorded.
const DEMO_MODES: [ControlMode; 2] = [ControlMode::EeDeltaPose, ControlMode::JointPos];

const DEMO_MODE_PARSER: NameParser<ControlMode, UnknownName> = NameParser {
    parse: |typed| pick("control mode", typed, &DEMO_MODES, ControlMode::name),
    names: || DEMO_MODES.map(ControlMode::name).to_vec(),
};

impl Cli {
    /// Parses a whole command line, program name included. If `run` names a sweep file, its options are merged in.
    ///
    /// # Errors
    /// If an argument is invalid ([`clap::Error`], which also carries help and version texts) or the sweep file is
    /// ([`SweepFileError`](sweep_file::SweepFileError)).
    pub(crate) fn parse_with_sweep_file(words: &[OsString]) -> anyhow::Result<Self> {
        let matches = Self::command().try_get_matches_from(words)?;
        let Some(("run", run)) = matches.subcommand() else { return Ok(Self::from_arg_matches(&matches)?) };
        let Some(path) = run.get_one::<PathBuf>("file") else { return Ok(Self::from_arg_matches(&matches)?) };
        let is_typed = |id: &str| run.value_source(id) == Some(ValueSource::CommandLine);
        let flags = sweep_file::flags(path, is_typed)?;
        // There are no options before the subcommand: the first two words are the program and `run`.
        let (command, typed) = words.split_at(2);
        let merged = command.iter().chain(&flags).chain(typed);
        Ok(Self::from_arg_matches(&Self::command().try_get_matches_from(merged)?)?)
    }
}

fn parse_scale(typed: &str) -> Result<usize, String> {
    let scales = HighResScene::SCALES;
    typed
        .parse()
        .ok()
        .filter(|scale| scales.contains(scale))
        .ok_or_else(|| format!("expected {} to {}", scales.start(), scales.end()))
}

/// Parses the arguments of `run`, separated by spaces, and returns its options.
#[cfg(test)]
pub(crate) fn parse_run(arguments: &str) -> Result<SweepArgs, clap::Error> {
    let words = ["hypogeum", "run"].into_iter().chain(arguments.split_whitespace());
    let Command::Run(args) = Cli::try_parse_from(words)?.command else {
        unreachable!("the command is `run`")
    };
    Ok(args.sweep)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn command_definition_is_consistent() {
        Cli::command().debug_assert();
    }
}
