//! End-to-end throughput: env-steps per second of real runs across separate processes, and the fraction of
//! the theoretical bound that they reach.
//!
//! `cargo bench -p benches --bench fabric -- [--csv FILE]`. Each case is one `run --json` on RaiseCube of the
//! binary built by this package, with its own results file. The figures are those that the run reports
//! (docs/benchmark.md, "FPS"). Of three runs, the one with the median throughput is reported. ACT uses random
//! weights: the full-size network and a tiny one.

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use benches::Report;
use ipc_types::Morphology;
use policy_host::models::act::checkpoint::colosseum::ActConfig;
use policy_host::models::synthetic::write_checkpoint;
use serde_json::Value;

/// Runs per case.
const N_RUNS: usize = 3;

/// A benchmark case: one configuration of `hypogeum run`.
struct FabricCase {
    name: &'static str,
    policy: String,
    episodes: u32,
    /// Further command-line arguments.
    extra_args: &'static [&'static str],
}

fn main() -> Result<()> {
    let mut report = Report::from_args("fabric")?;
    let folder = tempfile::tempdir()?;
    let full = folder.path().join("full");
    let tiny = folder.path().join("tiny");
    write_checkpoint(&full, &ActConfig::full_size(Morphology::Single), 1)?;
    write_checkpoint(&tiny, &ActConfig::tiny(Morphology::Single), 1)?;
    let act = |path: &Path| format!("act=act:{}", path.display());
    let chunk: &[&str] = &["--mode", "chunk", "--execute", "30"];
    let cases = [
        FabricCase { name: "idle", policy: "idle".into(), episodes: 256, extra_args: chunk },
        FabricCase { name: "expert", policy: "expert".into(), episodes: 96, extra_args: &[] },
        FabricCase { name: "act_full_chunk30", policy: act(&full), episodes: 32, extra_args: chunk },
        FabricCase { name: "act_tiny_chunk30", policy: act(&tiny), episodes: 64, extra_args: chunk },
        FabricCase {
            name: "act_tiny_ensemble",
            policy: act(&tiny),
            episodes: 16,
            extra_args: &["--mode", "ensemble"],
        },
    ];
    for case in &cases {
        let runs = (0..N_RUNS).map(|round| run(case, folder.path(), round));
        let mut runs = runs.collect::<Result<Vec<_>>>()?;
        runs.sort_by(|a, b| a.env_steps_per_s.total_cmp(&b.env_steps_per_s));
        let Throughput { env_steps_per_s, bound, reached } = runs[N_RUNS / 2];
        println!(
            "{:18} {env_steps_per_s:8.0} env-steps/s, bound {bound:8.0}, {:5.1} % of the bound",
            case.name,
            100.0 * reached
        );
        report.add(case.name, env_steps_per_s, "env_steps_per_s", "RaiseCube; 16 envs; median of 3");
        report.add(case.name, bound, "bound_env_steps_per_s", "c / (s + (r + w) / k) of the same run");
        report.add(case.name, reached, "fraction_of_bound", "");
    }
    report.finish()
}

/// Throughput figures of one run.
struct Throughput {
    env_steps_per_s: f64,
    /// Upper bound on env-steps per second, computed from the run's own timings.
    bound: f64,
    /// Fraction of the bound.
    reached: f64,
}

fn run(case: &FabricCase, folder: &Path, round: usize) -> Result<Throughput> {
    let program = env!("CARGO_BIN_EXE_hypogeum-under-bench");
    let db = folder.join(format!("{}-{round}.db", case.name));
    let output = Command::new(program)
        .args(["run", "--json", "--tasks", "RaiseCube", "--perturbations", "none", "--envs", "16"])
        .args(["--policy", &case.policy, "--episodes", &case.episodes.to_string(), "--db"])
        .arg(db)
        .args(case.extra_args)
        .stdin(Stdio::null())
        .output()
        .with_context(|| format!("run {program}"))?;
    ensure!(output.status.success(), "{} failed: {}", case.name, String::from_utf8_lossy(&output.stderr));
    let result: Value = serde_json::from_slice(&output.stdout).context("parse the run's JSON output")?;
    let figure = |value: &Value, key| value.as_f64().with_context(|| format!("the run's JSON has no {key}"));
    let fps = &result["fps"];
    Ok(Throughput {
        env_steps_per_s: figure(&fps["env_steps_per_s"], "env_steps_per_s")?,
        bound: figure(&fps["bound"]["env_steps_per_s"], "bound")?,
        reached: figure(&fps["bound"]["reached"], "reached")?,
    })
}
