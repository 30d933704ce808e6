//! `hypogeum completions`: completion scripts for shells.

use clap::{Args, Command};
use clap_complete::Shell;

use crate::console::exit::{ExitStatus, Failure};
use crate::console::output::print_out;

/// Arguments of `completions`.
#[derive(Debug, Args)]
pub(crate) struct CompletionsArgs {
    /// Shell to write completions for
    pub(crate) shell: Shell,
}

/// Prints the completion script of the program whose command line is `command`.
pub(crate) fn completions(args: &CompletionsArgs, mut command: Command) -> Result<ExitStatus, Failure> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "hypogeum", &mut script);
    print_out(&String::from_utf8_lossy(&script))?;
    Ok(ExitStatus::Success)
}
