//! `hypogeum completions`: completion scripts for shells.

use clap::{Args, CommandFactory};
use clap_complete::Shell;

use crate::cli::Cli;
use crate::exit::{ExitStatus, Failure};
use crate::output::print_out;

/// Arguments of `completions`.
#[derive(Debug, Args)]
pub(crate) struct CompletionsArgs {
    /// Shell to write completions for
    pub(crate) shell: Shell,
}

/// Prints the completion script.
pub(crate) fn completions(args: &CompletionsArgs) -> Result<ExitStatus, Failure> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "hypogeum", &mut script);
    print_out(&String::from_utf8_lossy(&script))?;
    Ok(ExitStatus::Success)
}
