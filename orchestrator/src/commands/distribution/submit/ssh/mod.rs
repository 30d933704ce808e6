//! Machines that are reached by ssh alone: copies what a sweep needs, keeps a queue of its shards, and
//! fetches what they write.
//!
//! Each machine has one folder, in which `files` stands for the current folder here, so that relative paths
//! mean the same files. A shard's task ends in order when its standard input does: at Ctrl-C, and when the
//! connection or this process is gone.

mod host;
mod inputs;
mod pool;
mod remote;

use std::fmt::Write;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use anyhow::{Context, anyhow};
use clap::Args;

pub(crate) use self::host::SshHost;
use self::host::check_hosts;
pub(crate) use self::inputs::inputs;
use self::pool::ShardPool;
pub(crate) use self::remote::Remote;
use crate::commands::distribution::submit::sharded_sweep::{
    EngineDefaults, ParseRun, ShardedSweep, ShardingArgs, line,
};
use crate::commands::distribution::submit::tool::ToolOptions;
use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::interrupt;
use crate::console::output::{print_message, print_out};

/// Options of every connection. A user's own come before them, and the first one counts.
const SSH: [&str; 9] = [
    "-T",
    "-o",
    "BatchMode=yes",
    "-o",
    "ConnectTimeout=20",
    "-o",
    "ServerAliveInterval=15",
    "-o",
    "ServerAliveCountMax=4",
];

/// Arguments of `submit ssh`.
#[derive(Args, Clone, Debug)]
pub(crate) struct SshArgs {
    #[command(flatten)]
    pub(crate) sharding: ShardingArgs,
    /// Machines, comma-separated, with the number of shards that each runs at a time (1 by default), for
    /// example a,b,me@c:2. They need rsync, and keys that ask for no password
    #[arg(long, value_name = "HOST[:N],…", value_delimiter = ',', required = true)]
    hosts: Vec<SshHost>,
    /// Options of ssh, for example "-p 2222 -i key" (repeatable)
    #[arg(long, value_name = "OPTIONS", allow_hyphen_values = true)]
    ssh: Vec<ToolOptions>,
    /// Folder on each machine, relative to the home folder there [default: hypogeum-sweep-NAME]
    #[arg(long, value_name = "DIR")]
    remote: Option<String>,
}

/// Runs all shards and merges them.
pub(crate) fn submit(args: &SshArgs, parse: ParseRun<'_>) -> Result<ExitStatus, Failure> {
    check_hosts(&args.hosts).or_user()?;
    let sweep = ShardedSweep::resolve(&args.sharding, EngineDefaults::default(), parse)?;
    let inputs = inputs(&sweep, args.sharding.file.as_deref()).or_user()?;
    let root = args.remote.clone().unwrap_or_else(|| format!("hypogeum-sweep-{}", sweep.plain_name()));
    if root.starts_with(['~', '-']) || root.contains(':') || root.chars().any(char::is_control) {
        return Err(anyhow!("--remote is `{root}`, expected a folder without ~ and colons")).or_user();
    }
    let ssh = [ToolOptions::words(&args.ssh), SSH.map(str::to_owned).to_vec()].concat();
    let ssh = [vec!["ssh".to_owned()], ssh].concat();
    let folder = sweep.folder_text();
    let remotes: Vec<_> = args
        .hosts
        .iter()
        .map(|host| Remote { host: &host.name, ssh: &ssh, root: &root, folder: &folder })
        .collect();
    if args.sharding.dry_run {
        print_out(&description(&sweep, args, &remotes, &inputs)?)?;
        return Ok(ExitStatus::Success);
    }
    sweep.prepare()?;
    let signals = Arc::new(AtomicU32::new(0));
    let watched = Arc::clone(&signals);
    let watch = interrupt::watch(move || {
        watched.fetch_add(1, Ordering::Relaxed);
    });
    let watch = watch.context("failed to install signal handlers")?;
    let pool = ShardPool::new(&sweep, &inputs, &signals).or_user()?;
    let n_missing = pool.run(args.hosts.iter().map(|host| host.n_tasks).zip(&remotes));
    drop(watch);
    if signals.load(Ordering::Relaxed) > 0 {
        print_message("interrupted; the same command resumes");
        return Ok(ExitStatus::Interrupted);
    }
    if n_missing > 0 {
        let n = sweep.shards;
        print_message(&format!(
            "{n_missing} of {n} shards have not finished; the same command runs them again"
        ));
    }
    merge(&sweep)
}

/// Merges what the shards have written, in a child.
fn merge(sweep: &ShardedSweep) -> Result<ExitStatus, Failure> {
    let program = std::env::current_exe().context("failed to find this program").or_user()?;
    let status = Command::new(program).args(sweep.merge_words()).status();
    let status = status.context("failed to start the merge").or_user()?;
    match status.code() {
        Some(0) => Ok(ExitStatus::Success),
        Some(1) => Ok(ExitStatus::EpisodeErrors),
        Some(130) => Ok(ExitStatus::Interrupted),
        _ => Err(anyhow!("the merge failed: {status}")).or_user(),
    }
}

/// Describes what would be done.
fn description(
    sweep: &ShardedSweep,
    args: &SshArgs,
    remotes: &[Remote<'_>],
    inputs: &[String],
) -> Result<String, Failure> {
    let mut text = String::new();
    for (host, remote) in args.hosts.iter().zip(remotes) {
        let _ = writeln!(text, "{}, {} at a time, in {}:", host.name, host.n_tasks, remote.root);
        let _ = writeln!(text, "  bin/hypogeum: {}", sweep.program);
        let _ = writeln!(text, "  files: {}", line(inputs)?);
        let shard = format!("I/{}", sweep.shards);
        let _ = writeln!(text, "  {}", line(&remote.task_words(&sweep.run_words(&shard)).or_user()?)?);
    }
    let _ = writeln!(text, "then here: hypogeum {}", line(&sweep.merge_words())?);
    Ok(text)
}
