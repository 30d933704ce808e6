//! Transfer from the original: success here of a policy that was trained and evaluated there.
//!
//! `cargo bench -p benches --bench transfer -- [--csv FILE]`. `checkpoints/act-original` saw nothing but the
//! original's images and motions of RaiseCube; its README tells how it was trained and what it reached there.
//! The benchmark runs 200 episodes of RaiseCube with 15 executed rows and reports the success rate with its
//! 95 % interval. Takes about a minute.

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use benches::Report;
use serde_json::Value;

/// Successes and episodes of the same policy in the original (PhysX on the CPU, images of SAPIEN).
const IN_THE_ORIGINAL: [f64; 2] = [81.0, 120.0];

fn main() -> Result<()> {
    let mut report = Report::from_args("transfer")?;
    let folder = tempfile::tempdir()?;
    let checkpoint = concat!(env!("CARGO_MANIFEST_DIR"), "/../checkpoints/act-original");
    let program = env!("CARGO_BIN_EXE_hypogeum-under-bench");
    let output = Command::new(program)
        .args(["run", "--json", "--tasks", "RaiseCube", "--episodes", "200", "--seed", "4242"])
        .args(["--execute", "15", "--policy", &format!("act-original=act:{checkpoint}"), "--db"])
        .arg(folder.path().join("transfer.db"))
        .stdin(Stdio::null())
        .output()
        .with_context(|| format!("run {program}"))?;
    ensure!(output.status.success(), "the run failed: {}", String::from_utf8_lossy(&output.stderr));
    let result: Value = serde_json::from_slice(&output.stdout).context("parse the run's JSON output")?;
    let cell = &result["cells"][0];
    let figure = |value: &Value| value.as_f64().context("the run's JSON has no success rate");
    let here = figure(&cell["success_once"])?;
    let [low, high] = [figure(&cell["wilson95"][0])?, figure(&cell["wilson95"][1])?];
    let there = IN_THE_ORIGINAL[0] / IN_THE_ORIGINAL[1];
    println!("in the original {:.1} %, here {:.1} %", 100.0 * there, 100.0 * here);
    println!("95 % interval here: {:.1} to {:.1} %", 100.0 * low, 100.0 * high);
    report.add("RaiseCube/original", there, "success_once", "120 episodes");
    report.add("RaiseCube/here", here, "success_once", "200 episodes");
    report.finish()
}
