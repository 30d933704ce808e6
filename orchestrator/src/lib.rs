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

mod cli;
mod commands;
mod console;
mod fleet;
#[cfg(feature = "fuzzing")]
#[doc(hidden)]
#[path = "../tests/fuzzing/mod.rs"]
pub mod fuzzing;
mod plan;
mod run;
mod selection;
pub mod statistics;
mod store;
mod study;

use std::ffi::OsString;
use std::io::{self, Write};
use std::process::ExitCode;
use std::thread;

use run_config::{printable, shorten};

use crate::cli::Cli;
use crate::console::exit::{ExitStatus, Failure};
use crate::console::output::{OutputError, print_message};

/// Stack of the thread that runs a command, in bytes.
const STACK: usize = 8 << 20;

/// Runs the program on the arguments of this process.
///
/// Exit codes: 0 success, 1 finished with errored episodes, 2 user error, 3 bug, 130 interrupted.
#[must_use]
pub fn main() -> ExitCode {
    console::surroundings::adapt();
    // The stack of the first thread is as large as the user's limit, that of others as large as they ask for.
    match thread::Builder::new().stack_size(STACK).spawn(parse_and_run) {
        // A panic has printed its message.
        Ok(running) => running.join().unwrap_or_else(|_| ExitCode::from(3)),
        Err(error) => {
            let failure = Failure::from(anyhow::Error::from(error).context("failed to start a thread"));
            print_message(&format!("error: {failure}"));
            failure.exit_code()
        }
    }
}

fn parse_and_run() -> ExitCode {
    let words: Vec<OsString> = std::env::args_os().collect();
    let result = match Cli::parse_with_sweep_file(&words) {
        Ok(cli) => cli.command.run(),
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
