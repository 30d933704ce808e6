//! The program `hypogeum`: reads what the user wants, runs the children that do it, keeps and reports what they found.
//!
//! It owns the command line, the processes of a run, the results file and everything a person reads. In a run it
//! never steps a world, evaluates a policy or sees an observation: episodes live in `sim`, policies in `policy-host`, and
//! both run as children of this process, which are this same program executed again. What needs no policy (`show`, `demos`,
//! `replay`) it has `sim` do on threads of its own.
//!
//! `cli` (as typed) → `plan` (as meant) → `work` (episodes to run) → `fleet` (children) → `results` (SQLite) → `report`.

mod checkpoint;
mod child;
mod cli;
mod demos;
mod failure;
mod fleet;
mod interrupt;
mod machine;
mod movie;
mod names;
mod plan;
mod policy;
mod progress;
mod replay;
mod report;
mod results;
mod run;
mod selection;
mod show;
mod suite;
mod sweep_file;
mod work;

use std::io::Write;
use std::process::ExitCode;
use std::time::Instant;

use crate::cli::{Cli, Command};
use crate::failure::{Ending, Failure};

/// Runs the program on this process's arguments.
///
/// Exit codes: 0 done, 1 finished with errored episodes, 2 user error, 3 bug, 130 interrupted.
#[must_use]
pub fn main() -> ExitCode {
    let started = Instant::now();
    match Cli::parse_with_sweep_file(&std::env::args_os().collect::<Vec<_>>()) {
        Ok(cli) => finish(run_command(&cli.command, started)),
        Err(error) => match error.downcast::<clap::Error>() {
            Ok(error) => {
                // Help and version texts are errors for clap, too. A failure to print leaves nothing to report it on.
                let _ = error.print();
                if error.use_stderr() { ExitCode::from(2) } else { ExitCode::SUCCESS }
            }
            Err(error) => finish(Err(Failure::User(error))),
        },
    }
}

fn run_command(command: &Command, started: Instant) -> Result<Ending, Failure> {
    match command {
        Command::Run(args) => run::run(args, started),
        Command::Tasks(args) => suite::list(args),
        Command::Show(args) => show::show(args),
        Command::Demos(args) => demos::demos(args),
        Command::Replay(args) => replay::replay(args),
        Command::Checkpoint(args) => checkpoint::write(args),
        Command::Sim(args) => child::sim(args),
        Command::PolicyHost(args) => child::policy_host(args),
    }
}

/// Prints the error, if there is one, and returns the exit code.
fn finish(result: Result<Ending, Failure>) -> ExitCode {
    match result {
        Ok(ending) => ending.exit_code(),
        Err(failure) => {
            // A closed stderr leaves the exit code to say it.
            let _ = writeln!(std::io::stderr().lock(), "error: {failure}");
            failure.exit_code()
        }
    }
}
