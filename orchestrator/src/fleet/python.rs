//! Modules of the Python package that ask policy servers.

use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, bail};
use policy_host::spec::server::PolicyServer;

/// Returns the command that offers the policy in a server as a host called `name`.
pub(crate) fn command(python: &Path, server: &PolicyServer, name: &str) -> Command {
    let mut command = Command::new(python);
    command.args(server.arguments(name));
    command
}

/// Connects to a server and returns what it says of itself. This shows before a run whether Python, the
/// package and the server are there.
///
/// # Errors
/// If one of them is not, or the arguments are wrong.
pub(crate) fn describe(python: &Path, server: &PolicyServer) -> anyhow::Result<String> {
    let mut command = command(python, server, "any");
    let output = command.args(["--describe", "--connect=10"]).stdin(Stdio::null()).output();
    let output = output.with_context(|| {
        format!("failed to start {}; choose a Python interpreter with --python", python.display())
    })?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned());
    }
    let log = String::from_utf8_lossy(&output.stderr);
    let last =
        log.lines().rfind(|line| !line.trim().is_empty()).unwrap_or("it ended without a message").trim();
    if last.contains("No module named 'hypogeum") || last.contains("No module named hypogeum") {
        let extra = server.protocol.name();
        bail!(
            "{} has no module {}: install the package (pip install './python[{extra}]'), or choose another interpreter \
             with --python",
            python.display(),
            server.protocol.module()
        );
    }
    bail!("{}", last.rsplit_once("error: ").map_or(last, |(_, message)| message))
}
