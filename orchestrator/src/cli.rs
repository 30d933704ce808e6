//! The command line as typed. Strings end in [`crate::plan`].

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use sim::show::HighResScene;

use crate::sweep::Sweep;

/// Evaluates robot policies over the tasks and perturbations of COLOSSEUM V2.
#[derive(Debug, Parser)]
#[command(name = "hypogeum", version, disable_help_subcommand = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Evaluate policies; the same command again continues where it stopped
    Run(RunArgs),
    /// List the task suite
    Tasks(TasksArgs),
    /// Draw what the cameras see at the start of episodes or along one, as a sheet or a movie
    Show(ShowArgs),
    /// Write the experts' successes as LeRobot datasets; the same command again continues where it stopped
    Demos(DemosArgs),
    /// Do stored episodes again, and say whether they come out the same bit for bit
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

/// `run`: a sweep file, flags that override it, and how to report.
#[derive(Debug, Args)]
pub(crate) struct RunArgs {
    /// File of the flags below as TOML keys (--control-mode is `control_mode`, --policy is the list `policies`)
    #[arg(value_name = "SWEEP.toml")]
    pub(crate) file: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) flags: Sweep,
    /// Print one JSON object instead of a table
    #[arg(long)]
    pub(crate) json: bool,
    /// Show no progress
    #[arg(long)]
    pub(crate) quiet: bool,
}

#[derive(Debug, Args)]
pub(crate) struct TasksArgs {
    /// Show which perturbation applies to which task, and why not
    #[arg(long)]
    pub(crate) matrix: bool,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct ShowArgs {
    /// Task
    pub(crate) task: String,
    /// Perturbation, several joined by + that act together, or all: a row for each that applies to the task
    #[arg(long, default_value = "None")]
    pub(crate) perturbation: String,
    /// How strong it is, above 0 and up to 1
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    pub(crate) strength: f64,
    /// Suite seed, as in `run`
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Index of the first episode under that seed
    #[arg(long, default_value_t = 0)]
    pub(crate) episode: u32,
    /// Show the starts of this many successive episodes, a row each
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64),
        conflicts_with_all = ["policy", "movie"])]
    pub(crate) episodes: u32,
    /// strict (evident intent) or paper (what the released code does)
    #[arg(long, default_value = "strict")]
    pub(crate) profile: String,
    /// rgb: what policies see; depth: near bright (viridis over log depth, 0.05 to 4 m at most, the range printed);
    /// seg: a colour for each body, arm, table, floor and walls (the legend printed); black is nothing
    #[arg(long, value_name = "VIEW", default_value = "rgb")]
    pub(crate) what: String,
    /// Let expert or idle act and show the start, the middle and the success (or end) of the episode
    #[arg(long, value_name = "SPEC")]
    pub(crate) policy: Option<String>,
    /// Write the whole episode, 20 control steps per second, as .png or .apng (exact) or .gif (small);
    /// the expert acts unless --policy says otherwise
    #[arg(long, value_name = "FILE")]
    pub(crate) movie: Option<PathBuf>,
    /// Sheet to write [default: TASK.png]
    #[arg(short, long, value_name = "FILE.png", conflicts_with = "movie")]
    pub(crate) output: Option<PathBuf>,
}

/// `demos`: what to demonstrate, how, and where to.
#[derive(Debug, Args)]
pub(crate) struct DemosArgs {
    /// Folder to write to: a dataset each in single/ and bimanual/
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: PathBuf,
    /// Tasks, comma-separated: names, all, single or bimanual
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "all")]
    pub(crate) tasks: Vec<String>,
    /// Successful episodes of each task
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub(crate) episodes: u32,
    /// Seed of the suite; keep it apart from those you evaluate with, whose default is 0
    #[arg(long, value_name = "S", default_value_t = 1000)]
    pub(crate) seed: u64,
    /// Perturbation, or several joined by +
    #[arg(long, value_name = "NAME", default_value = "None")]
    pub(crate) perturbation: String,
    /// How strong it is, above 0 and up to 1
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    pub(crate) strength: f64,
    /// strict (evident intent) or paper (what the released code does)
    #[arg(long, default_value = "strict")]
    pub(crate) profile: String,
    /// How single-arm experts' episodes are told: pd_ee_delta_pose or pd_joint_pos
    #[arg(long, value_name = "MODE", default_value = "pd_ee_delta_pose")]
    pub(crate) control_mode: String,
    /// jpeg (quality 95) or png (exact, and several times as large)
    #[arg(long, value_name = "FORMAT", default_value = "jpeg")]
    pub(crate) images: String,
    /// Worker threads [default: one per core]
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub(crate) threads: Option<u32>,
    /// Show no progress
    #[arg(long)]
    pub(crate) quiet: bool,
}

/// `replay`: which episodes of which dataset or results file.
#[derive(Debug, Args)]
pub(crate) struct ReplayArgs {
    /// Dataset, which is single/ or bimanual/ in a folder that `demos` wrote, or a results file of `run --keep-actions`
    #[arg(value_name = "DATASET|FILE.db")]
    pub(crate) source: PathBuf,
    /// Episodes, comma-separated indices in it [default: all, or the first for a movie]
    #[arg(long, value_name = "LIST", value_delimiter = ',', conflicts_with_all = ["policy", "task", "perturbation"])]
    pub(crate) episodes: Vec<usize>,
    /// Only episodes of this policy, by its name in the results
    #[arg(long, value_name = "NAME")]
    pub(crate) policy: Option<String>,
    /// Only episodes of this task
    #[arg(long, value_name = "NAME")]
    pub(crate) task: Option<String>,
    /// Only episodes under this perturbation, or these joined by +
    #[arg(long, value_name = "NAME")]
    pub(crate) perturbation: Option<String>,
    /// So many of them, drawn at random
    #[arg(long, value_name = "N", conflicts_with_all = ["episodes", "movie"])]
    pub(crate) sample: Option<usize>,
    /// Seed of the draw
    #[arg(long, value_name = "S", default_value_t = 0, requires = "sample")]
    pub(crate) seed: u64,
    /// Write the first of them as a movie of all cameras: .png or .apng (exact) or .gif (small)
    #[arg(long, value_name = "FILE")]
    pub(crate) movie: Option<PathBuf>,
    /// Its pixels per pixel that policies see, along each edge, 1 to 8; they see 224 of each scene camera, 128 of each hand's
    #[arg(long, value_name = "N", default_value_t = 1, requires = "movie", value_parser = scale)]
    pub(crate) scale: usize,
    /// Show no progress
    #[arg(long)]
    pub(crate) quiet: bool,
}

fn scale(typed: &str) -> Result<usize, String> {
    let times = HighResScene::SCALES;
    typed
        .parse()
        .ok()
        .filter(|scale| times.contains(scale))
        .ok_or_else(|| format!("expected {} to {}", times.start(), times.end()))
}

#[derive(Debug, Args)]
pub(crate) struct CheckpointArgs {
    /// Folder to write it to; created if absent
    #[arg(short, long, value_name = "DIR")]
    pub(crate) output: PathBuf,
    /// full (the benchmark's) or tiny (for tests)
    #[arg(long, default_value = "full")]
    pub(crate) size: String,
    /// Seed of the weights
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
}

#[derive(Debug, Args)]
pub(crate) struct ChildArgs {
    /// Everything the child is told, as JSON
    #[arg(long, value_name = "JSON")]
    pub(crate) config: String,
}
