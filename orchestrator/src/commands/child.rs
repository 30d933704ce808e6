//! The hidden commands that `run` executes as its child processes.

use std::os::unix::process::CommandExt;

use anyhow::Context;
use clap::Args;
use ipc_types::link::Domain;
use policy_host::PolicySpec;
use policy_host::serve::{HostConfig, ServeError};
use policy_host::spec::server::PolicyServer;
use serde::de::DeserializeOwned;
use sim::serve::SimError;
use sim::serve::protocol::SimConfig;

use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::fleet::{python, server_endpoint, tell_kernel};

/// Arguments of the child processes.
#[derive(Debug, Args)]
pub(crate) struct ChildArgs {
    /// The whole configuration of the child as JSON
    #[arg(long, value_name = "JSON")]
    pub(crate) config: String,
}

/// Serves episodes until stdin closes.
pub(crate) fn sim(args: &ChildArgs) -> Result<ExitStatus, Failure> {
    rename_process("hypogeum-sim");
    let config: SimConfig = parse_config(args)?;
    let served = sim::serve::serve(&config).map_err(|error| match error {
        SimError::Sentences(_) => Failure::User(error.into()),
        error => error.into(),
    });
    leave(&config.domain, served)
}

/// Answers queries until stdin closes.
pub(crate) fn policy_host(args: &ChildArgs) -> Result<ExitStatus, Failure> {
    rename_process("hypogeum-host");
    let config: HostConfig = parse_config(args)?;
    let domain = config.domain.clone();
    if let PolicySpec::Server(server) = &config.spec {
        return become_python(&config, server);
    }
    let served = policy_host::serve::serve(config).map_err(|error| match error {
        ServeError::Load(_) | ServeError::Changed(_) => Failure::User(error.into()),
        // The variant is transparent, so that its own type would not be found among the causes.
        ServeError::Link(error) => error.into(),
        error => error.into(),
    });
    leave(&domain, served)
}

/// Replaces this process by the Python module that asks a server. Returns only if that fails.
fn become_python(config: &HostConfig, server: &PolicyServer) -> Result<ExitStatus, Failure> {
    let python = &config.run.resources.python;
    let mut command = python::command(python, server, &server_endpoint(config.run_id, config.lane.lane));
    if let Some(base) = config.domain.root.parent() {
        command.arg("--base").arg(base);
    }
    let error = command.args(["--supervised", "--timeout=60"]).exec();
    Err(error).with_context(|| format!("failed to start {}", python.display())).or_user()
}

/// Frees the shared memory of a run's exited processes. Exits with code 1 if that took too long.
pub(crate) fn reap(args: &ChildArgs) -> Result<ExitStatus, Failure> {
    let domain: Domain = parse_config(args)?;
    Ok(if domain.reap().is_some() { ExitStatus::Success } else { ExitStatus::EpisodeErrors })
}

/// Sets the name that `top` and `ps` show, at most 15 bytes. The kernel's is that of the link to the program.
fn rename_process(name: &str) {
    // A cosmetic matter, which no child fails for.
    let _ = tell_kernel("/proc/self/comm", name);
}

/// Ends a child that has served. If its parent was killed, the last child removes the run's shared memory.
///
/// Exit code 2 tells the parent that the user can fix the error, so that another attempt is of no use.
fn leave(domain: &Domain, served: Result<(), Failure>) -> Result<ExitStatus, Failure> {
    domain.remove_if_unused();
    served.map(|()| ExitStatus::Success)
}

fn parse_config<T: DeserializeOwned>(args: &ChildArgs) -> Result<T, Failure> {
    serde_json::from_str(&args.config).context("failed to parse --config").or_user()
}
