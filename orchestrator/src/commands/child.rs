//! The two hidden commands that `run` executes as its child processes.

use anyhow::Context;
use clap::Args;
use serde::de::DeserializeOwned;

use crate::exit::{ExitStatus, Failure, OrUser};

/// Arguments of the child processes.
#[derive(Debug, Args)]
pub(crate) struct ChildArgs {
    /// The whole configuration of the child as JSON
    #[arg(long, value_name = "JSON")]
    pub(crate) config: String,
}

/// Serves episodes until stdin closes.
pub(crate) fn sim(args: &ChildArgs) -> Result<ExitStatus, Failure> {
    sim::serve::serve(&parse_config(args)?)?;
    Ok(ExitStatus::Success)
}

/// Answers queries until stdin closes.
pub(crate) fn policy_host(args: &ChildArgs) -> Result<ExitStatus, Failure> {
    policy_host::serve::serve(parse_config(args)?)?;
    Ok(ExitStatus::Success)
}

fn parse_config<T: DeserializeOwned>(args: &ChildArgs) -> Result<T, Failure> {
    serde_json::from_str(&args.config).context("failed to parse --config").or_user()
}
