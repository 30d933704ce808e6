//! The programs of engines, which `submit` calls.

use std::io::{self, Write};
use std::process::{Command, Stdio};

use anyhow::{Context, anyhow, ensure};

use crate::console::exit::{Failure, OrUser};

/// Options of an engine's program that a user typed as one argument.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ToolOptions(pub(crate) String);

impl std::str::FromStr for ToolOptions {
    type Err = &'static str;

    fn from_str(typed: &str) -> Result<Self, &'static str> {
        let is_line = !typed.chars().any(char::is_control);
        if is_line && shlex::split(typed).is_some_and(|words| !words.is_empty()) {
            Ok(Self(typed.to_owned()))
        } else {
            Err("expected options on one line, with all quotes closed")
        }
    }
}

impl ToolOptions {
    /// Returns the words of all options.
    pub(crate) fn words(all: &[Self]) -> Vec<String> {
        all.iter().filter_map(|Self(line)| shlex::split(line)).flatten().collect()
    }
}

/// Runs a program with this input, and returns its output.
pub(crate) fn run(program: &str, arguments: &[String], input: &str) -> Result<String, Failure> {
    let run = || -> anyhow::Result<String> {
        let mut child = Command::new(program)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .with_context(|| format!("failed to start {program}, with which a job is submitted"))?;
        let mut stdin = child.stdin.take().context("a child has an input")?;
        match stdin.write_all(input.as_bytes()) {
            // It has an error to report.
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => {}
            written => written.with_context(|| format!("failed to write to {program}"))?,
        }
        drop(stdin);
        let output = child.wait_with_output().with_context(|| format!("failed to wait for {program}"))?;
        ensure!(output.status.success(), "{}", refusal(program, output.status, &output.stderr));
        String::from_utf8(output.stdout).map_err(|_| anyhow!("the output of {program} is not text"))
    };
    run().or_user()
}

/// Describes the failure of a program in one line.
pub(crate) fn refusal(program: &str, status: std::process::ExitStatus, stderr: &[u8]) -> String {
    let stderr = String::from_utf8_lossy(stderr);
    let lines: Vec<&str> = stderr.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    match lines.as_slice() {
        [] => format!("{program} failed: {status}"),
        lines => format!("{program} failed: {}", lines.join("; ")),
    }
}
