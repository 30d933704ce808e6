//! `hypogeum submit`: gives the shards of a sweep to an engine that exists already, and merges what they
//! leave.
//!
//! Each engine is a file: it fills a template, of which users can have their own, and hands it over. There is
//! no engine of our own; `ssh` only keeps a queue.

mod hyperqueue;
mod kubernetes;
mod sharded_sweep;
mod slurm;
mod ssh;
mod template;
#[cfg(test)]
mod tests;
mod tool;

use clap::{Args, Subcommand};

use self::sharded_sweep::ParseRun;
use crate::console::exit::{ExitStatus, Failure};

/// Arguments of `submit`.
#[derive(Debug, Args)]
pub(crate) struct SubmitArgs {
    #[command(subcommand)]
    engine: EngineArgs,
}

/// An engine with its arguments.
#[derive(Debug, Subcommand)]
enum EngineArgs {
    /// Submit a job array to Slurm, and a job after it that merges
    Slurm(Box<slurm::SlurmArgs>),
    /// Submit one task per shard to HyperQueue, and a task after them that merges
    Hyperqueue(Box<hyperqueue::HyperqueueArgs>),
    /// Apply an Indexed Job to Kubernetes, and a Job that merges
    Kubernetes(Box<kubernetes::KubernetesArgs>),
    /// Run the shards on machines without a scheduler or shared files, and merge; the same command again
    /// resumes
    Ssh(Box<ssh::SshArgs>),
}

/// Submits a sweep. `parse` parses the arguments of `run`.
pub(crate) fn submit(args: &SubmitArgs, parse: ParseRun<'_>) -> Result<ExitStatus, Failure> {
    match &args.engine {
        EngineArgs::Slurm(args) => slurm::submit(args, parse),
        EngineArgs::Hyperqueue(args) => hyperqueue::submit(args, parse),
        EngineArgs::Kubernetes(args) => kubernetes::submit(args, parse),
        EngineArgs::Ssh(args) => ssh::submit(args, parse),
    }
}
