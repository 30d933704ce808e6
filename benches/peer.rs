//! A peer: another implementation of the same work, run as a process beside ours and timed in turn with it.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use anyhow::{Context, Result, ensure};

/// A Python script of `peers/`: a request is a line, its answer a line with the seconds it took. It ends with this value.
#[derive(Debug)]
pub struct Peer {
    /// What it says of itself.
    pub name: String,
    process: Child,
    requests: ChildStdin,
    answers: BufReader<ChildStdout>,
}

impl Peer {
    /// Starts `peers/SCRIPT` with these arguments and waits until it is ready.
    ///
    /// # Errors
    /// If it cannot be started or ends at once.
    pub fn start(python: &Path, script: &str, arguments: &[&str]) -> Result<Self> {
        let script: PathBuf = [env!("CARGO_MANIFEST_DIR"), "peers", script].iter().collect();
        let mut process = Command::new(python)
            .arg(&script)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .with_context(|| format!("start {} {}", python.display(), script.display()))?;
        let requests = process.stdin.take().context("the peer has a standard input")?;
        let answers = BufReader::new(process.stdout.take().context("the peer has a standard output")?);
        let mut peer = Self { name: String::new(), process, requests, answers };
        peer.name = peer.answer()?;
        Ok(peer)
    }

    /// The seconds that a request took.
    ///
    /// # Errors
    /// If the peer has ended, or answers anything else.
    pub fn request(&mut self, request: &str) -> Result<f64> {
        writeln!(self.requests, "{request}")?;
        let answer = self.answer()?;
        answer.parse().with_context(|| format!("the peer answers with seconds, found {answer}"))
    }

    fn answer(&mut self) -> Result<String> {
        let mut line = String::new();
        self.answers.read_line(&mut line)?;
        ensure!(!line.is_empty(), "the peer ended; what it wrote above says why");
        Ok(line.trim().to_owned())
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
