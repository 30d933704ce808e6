//! The command line as typed. Strings end in [`crate::plan`].

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

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
    /// Draw what the cameras see at the start of an episode, or along it
    Show(ShowArgs),
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
    /// Perturbation
    #[arg(long, default_value = "None")]
    pub(crate) perturbation: String,
    /// Suite seed, as in `run`
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Index of the episode under that seed
    #[arg(long, default_value_t = 0)]
    pub(crate) episode: u32,
    /// strict (evident intent) or paper (what the released code does)
    #[arg(long, default_value = "strict")]
    pub(crate) profile: String,
    /// expert: draw the start, the middle and the success of its episode, not the start alone
    #[arg(long, value_name = "SPEC")]
    pub(crate) policy: Option<String>,
    /// Picture to write [default: TASK.png]
    #[arg(short, long, value_name = "FILE.png")]
    pub(crate) output: Option<PathBuf>,
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
