//! The two hidden commands that `run` executes as its child processes.

use anyhow::Context;
use clap::Args;
use ipc_types::link::Domain;
use policy_host::serve::HostConfig;
use serde::de::DeserializeOwned;
use sim::serve::protocol::SimConfig;

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
    let config: SimConfig = parse_config(args)?;
    leave(&config.domain, sim::serve::serve(&config))
}

/// Answers queries until stdin closes.
pub(crate) fn policy_host(args: &ChildArgs) -> Result<ExitStatus, Failure> {
    let config: HostConfig = parse_config(args)?;
    let domain = config.domain.clone();
    leave(&domain, policy_host::serve::serve(config))
}

/// Ends a child that has served. If its parent was killed, the last child removes the run's shared memory.
fn leave<E: Into<Failure>>(domain: &Domain, served: Result<(), E>) -> Result<ExitStatus, Failure> {
    domain.remove_if_unused();
    served.map(|()| ExitStatus::Success).map_err(Into::into)
}

fn parse_config<T: DeserializeOwned>(args: &ChildArgs) -> Result<T, Failure> {
    serde_json::from_str(&args.config).context("failed to parse --config").or_user()
}
