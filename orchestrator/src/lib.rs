//! The program `hypogeum`: parses the command line, runs the child processes that do the work, and stores and
//! reports their results.
//!
//! It owns the command line, the processes of a run, the results file and all user-visible text. During a run
//! it never steps a world, evaluates a policy or reads an observation: episodes run in `sim` and policies in
//! `policy-host`, both as children of this process, which execute the same program. Commands that need no
//! policy (`show`, `demos`, `replay`) run `sim` on threads of this process.
//!
//! `cli` (arguments) → `plan` (resolved run) → `jobs` (episodes to run) → `fleet` (children) → `results`
//! (SQLite) → `report`.

mod analysis;
mod build_identity;
mod capacity;
mod cli;
mod commands;
mod condition;
mod demos;
mod evaluation_args;
mod execution;
mod exit;
mod export;
mod fleet;
#[doc(hidden)]
pub mod fuzzing;
mod interrupt;
mod jobs;
mod lanes;
mod live;
mod machine;
mod movie;
mod names;
mod output;
mod output_files;
mod package;
mod page;
mod parquet_table;
mod plan;
mod playback;
mod policy;
mod progress;
mod report;
mod results;
mod selection;
mod speed;
pub mod statistics;
mod stopping;
mod stored_episode;
mod surroundings;
mod sweep;
mod table;
mod trace_file;

use std::ffi::OsString;
use std::io::{self, Write};
use std::process::ExitCode;
use std::thread;
use std::time::Instant;

use anyhow::Context;
use clap::CommandFactory;
use run_config::allotment::n_cores;
use run_config::{printable, shorten};

use crate::cli::{Cli, Command};
use crate::commands::{
    checkpoint, child, compare, completions, demos as demos_command, doctor, fps, pack, plan as plan_command,
    replay, report as report_command, run, show, tasks, verify,
};
use crate::exit::{ExitStatus, Failure};
use crate::output::{OutputError, print_message};

/// Stack of the thread that runs a command, in bytes.
const STACK: usize = 8 << 20;

/// Runs the program on the arguments of this process.
///
/// Exit codes: 0 success, 1 finished with errored episodes, 2 user error, 3 bug, 130 interrupted.
#[must_use]
pub fn main() -> ExitCode {
    let started = Instant::now();
    surroundings::adapt();
    // The stack of the first thread is as large as the user's limit, that of others as large as they ask for.
    match thread::Builder::new().stack_size(STACK).spawn(move || parse_and_run(started)) {
        // A panic has printed its message.
        Ok(running) => running.join().unwrap_or_else(|_| ExitCode::from(3)),
        Err(error) => {
            let failure = Failure::from(anyhow::Error::from(error).context("failed to start a thread"));
            print_message(&format!("error: {failure}"));
            failure.exit_code()
        }
    }
}

fn parse_and_run(started: Instant) -> ExitCode {
    let words: Vec<OsString> = std::env::args_os().collect();
    let result = match Cli::parse_with_sweep_file(&words) {
        Ok(cli) => run_command(&cli.command, started),
        Err(error) => match error.downcast::<clap::Error>() {
            Ok(error) if error.use_stderr() => {
                // If stderr cannot be written, nothing can report it.
                let _ = write!(io::stderr(), "{}", printable(&shorten(&error.render().to_string())));
                return ExitCode::from(2);
            }
            // clap also returns help and version texts as errors.
            Ok(text) => match text.print() {
                Err(refused) => Err(OutputError::from(refused).into()),
                Ok(()) => Ok(ExitStatus::Success),
            },
            Err(error) => Err(Failure::User(error)),
        },
    };
    match result {
        Ok(status) => status.exit_code(),
        Err(failure) => {
            print_message(&format!("error: {failure}"));
            failure.exit_code()
        }
    }
}

fn run_command(command: &Command, started: Instant) -> Result<ExitStatus, Failure> {
    use Command as C;
    let works_here = matches!(
        command,
        C::Compare(_) | C::Show(_) | C::Replay(_) | C::Report(_) | C::Doctor(_) | C::Fps(_)
    );
    if works_here {
        start_threads()?;
    }
    match command {
        Command::Run(args) => run::run(args, started),
        Command::Compare(args) => compare::compare(args),
        Command::Plan(args) => plan_command::plan(args),
        Command::Tasks(args) => tasks::tasks(args),
        Command::Show(args) => show::show(args),
        Command::Demos(args) => demos_command::demos(args),
        Command::Replay(args) => replay::replay(args),
        Command::Report(args) => report_command::report(args),
        Command::Doctor(args) => doctor::doctor(args),
        Command::Verify(args) => verify::verify(args),
        Command::Fps(args) => fps::fps(args),
        Command::Pack(args) => pack::pack(args),
        Command::Checkpoint(args) => checkpoint::checkpoint(args),
        Command::Completions(args) => completions::completions(args, Cli::command()),
        Command::Sim(args) => child::sim(args),
        Command::PolicyHost(args) => child::policy_host(args),
        Command::Reap(args) => child::reap(args),
    }
}

/// Starts the threads of commands that work in this process. Otherwise they start when they are first needed,
/// with a panic if the system refuses.
fn start_threads() -> Result<(), Failure> {
    Ok(rayon::ThreadPoolBuilder::new()
        .num_threads(n_cores() as usize)
        .build_global()
        .context("failed to start threads")?)
}
