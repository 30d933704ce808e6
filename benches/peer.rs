//! Peer processes: other implementations of the same workload, timed alternately with ours.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Duration;

use anyhow::{Context, Result, ensure};

/// Time after a response in which the peer's worker threads may still spin in expectation of more work.
const COOL_DOWN: Duration = Duration::from_millis(100);

/// A Python script in `peers/`. A request is a line on its standard input; the response is a line on its
/// standard output with the elapsed time in s. Dropping the value kills the process.
#[derive(Debug)]
pub struct Peer {
    /// Name and version, as reported by the script when it is ready.
    pub name: String,
    process: Child,
    requests: ChildStdin,
    responses: BufReader<ChildStdout>,
}

impl Peer {
    /// Starts `peers/SCRIPT` with the given arguments and waits until it is ready.
    ///
    /// # Errors
    /// If it cannot be started, or exits before it is ready.
    pub fn start(python: &Path, script: &str, arguments: &[&str]) -> Result<Self> {
        let script: PathBuf = [env!("CARGO_MANIFEST_DIR"), "peers", script].iter().collect();
        let mut process = Command::new(python)
            .arg(&script)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .with_context(|| format!("start {} {}", python.display(), script.display()))?;
        let requests = process.stdin.take().context("the peer's standard input is not piped")?;
        let responses =
            BufReader::new(process.stdout.take().context("the peer's standard output is not piped")?);
        let mut peer = Self { name: String::new(), process, requests, responses };
        peer.name = peer.read_line()?;
        Ok(peer)
    }

    /// Sends a request and returns the elapsed time in s that the peer reports, once the peer is idle again.
    ///
    /// # Errors
    /// If the peer has exited, or responds with anything other than a number.
    pub fn request(&mut self, request: &str) -> Result<f64> {
        writeln!(self.requests, "{request}")?;
        let response = self.read_line()?;
        std::thread::sleep(COOL_DOWN);
        response.parse().with_context(|| format!("the peer must respond with a time in s, found {response}"))
    }

    fn read_line(&mut self) -> Result<String> {
        let mut line = String::new();
        self.responses.read_line(&mut line)?;
        ensure!(!line.is_empty(), "the peer exited; see its output above for the reason");
        Ok(line.trim().to_owned())
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
