//! The number of envs that `run` chooses by itself, against the best of a grid of fixed numbers.
//!
//! `cargo bench -p benches --bench autotune -- [--peer PYTHON] [--rounds N] [--only NAMES] [--csv FILE]`
//!
//! Each workload runs with `--envs auto` and with every number of the grid in turn, for several rounds.
//! Machines drift by a fifth within a minute, so `env_steps_per_s` (docs/measuring.md) is scaled by the
//! register peak measured just before and after the run, relative to the median peak of the workload's runs.
//! Figures are medians over the rounds. All runs of a workload must store the same rows. With `--peer`, a
//! Python interpreter with numpy, workloads with a foreign host are measured, too. Takes about six minutes
//! per round on two cores.

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use anyhow::{Context, Result, ensure};
use benches::{Report, median};
use policy_host::nn::gemm::peak::peak_gflop_per_s;
use rusqlite::Connection;
use serde_json::Value;

const HYPOGEUM: &str = env!("CARGO_BIN_EXE_hypogeum-under-bench");
/// Fixed numbers of envs.
const GRID: [u32; 6] = [8, 16, 32, 64, 128, 256];
/// The trained ACT of this repository.
const SMALL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../checkpoints/act-small");

/// A sweep to run with several numbers of envs.
struct Workload {
    name: &'static str,
    /// Arguments of `run`; `FULL` and `SMALL` stand for checkpoints.
    args: &'static str,
    /// Arguments of `peers/slow_host.py` after the name.
    host: Option<[&'static str; 2]>,
}

const WORKLOADS: [Workload; 10] = [
    Workload { name: "state", args: "--policy idle --episodes 15", host: None },
    Workload {
        name: "images",
        args: "--policy a=attach:NAME --tasks RaiseCube,StackCube --episodes 150 --execute 1",
        host: Some(["0", "0"]),
    },
    Workload {
        name: "small_chunk",
        args: "--policy act=act:SMALL --tasks RaiseCube,StackCube,PickDishFromRack,OpenDrawer --episodes 60",
        host: None,
    },
    Workload {
        name: "small_ensemble",
        args: "--policy act=act:SMALL --tasks RaiseCube,StackCube,OpenDrawer --episodes 8 --mode ensemble",
        host: None,
    },
    Workload {
        name: "full_chunk",
        args: "--policy act=act:FULL --tasks RaiseCube,StackCube --episodes 36",
        host: None,
    },
    Workload {
        name: "full_ensemble",
        args: "--policy act=act:FULL --tasks RaiseCube --episodes 4 --mode ensemble",
        host: None,
    },
    Workload {
        name: "two_policies",
        args: "--policy small=act:SMALL --policy full=act:FULL --tasks RaiseCube,StackCube --episodes 24",
        host: None,
    },
    Workload {
        name: "bimanual",
        args: "--policy act=act:SMALL --tasks DualArmLiftPot,DualArmPushBox,DualArmLiftTray --episodes 60",
        host: None,
    },
    Workload {
        name: "slow_host",
        args: "--policy a=attach:NAME --tasks RaiseCube,StackCube,OpenDrawer --episodes 400",
        host: Some(["0.05", "0.002"]),
    },
    Workload { name: "one_cell", args: "--policy act=act:SMALL --tasks RaiseCube --episodes 10", host: None },
];

fn main() -> Result<()> {
    let (mut peer, mut n_rounds, mut only) = (None, 3, None);
    let usage = "--peer PYTHON, --rounds N, --only NAMES, ";
    let mut report = Report::with_options("autotune", usage, |option, value| {
        match option {
            "--peer" => peer = Some(PathBuf::from(value)),
            "--rounds" => n_rounds = value.parse().context("--rounds needs a number")?,
            "--only" => only = Some(value.to_owned()),
            _ => return Ok(false),
        }
        Ok(true)
    })?;
    let folder = tempfile::tempdir()?;
    let full = folder.path().join("full");
    let checkpoint = Command::new(HYPOGEUM).args(["checkpoint", "-o"]).arg(&full).output()?;
    ensure!(checkpoint.status.success(), "{}", String::from_utf8_lossy(&checkpoint.stderr));
    let bench = GridBench { folder: folder.path(), full: &full, python: peer.as_deref(), n_rounds };
    let is_selected = |workload: &&Workload| {
        (workload.host.is_none() || peer.is_some())
            && only.as_ref().is_none_or(|only| only.split(',').any(|name| name == workload.name))
    };
    for workload in WORKLOADS.iter().filter(is_selected) {
        bench.measure(workload, &mut report)?;
    }
    report.finish()
}

struct GridBench<'a> {
    folder: &'a Path,
    full: &'a Path,
    python: Option<&'a Path>,
    n_rounds: usize,
}

/// The outcome of one run.
struct TunedRun {
    env_steps_per_s: f64,
    /// Mean register peak before and after the run, in GFLOP/s.
    peak: f64,
    /// The chosen number of envs, if none was given.
    chosen: Option<u64>,
    rows: Vec<String>,
}

impl GridBench<'_> {
    fn measure(&self, workload: &Workload, report: &mut Report) -> Result<()> {
        let mut runs: Vec<Vec<TunedRun>> = (0..=GRID.len()).map(|_| Vec::new()).collect();
        let (mut chosen, mut rows) = (Vec::new(), None);
        for _ in 0..self.n_rounds {
            for (idx, envs) in std::iter::once(None).chain(GRID.map(Some)).enumerate() {
                let run = self.run(workload, envs)?;
                chosen.extend(run.chosen);
                ensure!(
                    *rows.get_or_insert_with(|| run.rows.clone()) == run.rows,
                    "{}: rows differ with {envs:?} envs",
                    workload.name
                );
                runs[idx].push(run);
            }
        }
        let peak = median(&mut runs.iter().flatten().map(|run| run.peak).collect::<Vec<_>>());
        let scaled = |runs: &Vec<TunedRun>| -> f64 {
            median(&mut runs.iter().map(|run| run.env_steps_per_s * peak / run.peak).collect::<Vec<_>>())
        };
        let medians: Vec<f64> = runs.iter().map(scaled).collect();
        let best = (0..GRID.len()).max_by(|a, b| medians[a + 1].total_cmp(&medians[b + 1])).unwrap_or(0);
        let of_best = medians[0] / medians[best + 1];
        let grid: Vec<_> =
            GRID.iter().zip(&medians[1..]).map(|(envs, rate)| format!("{envs}: {rate:.1}")).collect();
        println!(
            "{:15} auto {:8.1} env-steps/s, {:5.1} % of the best fixed number; chose {chosen:?}; {}",
            workload.name,
            medians[0],
            100.0 * of_best,
            grid.join(", ")
        );
        report.add(workload.name, medians[0], "env_steps_per_s", "auto");
        for (envs, rate) in GRID.iter().zip(&medians[1..]) {
            report.add(workload.name, *rate, "env_steps_per_s", &format!("{envs} envs"));
        }
        report.add(workload.name, of_best, "auto_over_best", "ratio of medians");
        Ok(())
    }

    fn run(&self, workload: &Workload, envs: Option<u32>) -> Result<TunedRun> {
        let folder = tempfile::tempdir_in(self.folder)?;
        let db = folder.path().join("r.db");
        // A name of its own per run, so that a host cannot find an earlier run.
        let name = folder.path().file_name().map(|name| name.to_string_lossy().replace('.', "x"));
        let name = name.context("the folder has no name")?;
        let mut host = self.start_host(workload, &name)?;
        let args = workload.args.replace("FULL", &self.full.to_string_lossy());
        let args = args.replace("SMALL", SMALL).replace("NAME", &name);
        let envs = envs.map_or("auto".to_owned(), |envs| envs.to_string());
        let before = peak()?;
        let output = Command::new(HYPOGEUM)
            .args(["run", "--json", "--quiet", "--envs", &envs, "--db"])
            .arg(&db)
            .args(args.split_whitespace())
            .stdin(Stdio::null())
            .output()
            .with_context(|| format!("run {HYPOGEUM}"))?;
        if let Some(host) = &mut host {
            let _ = host.kill();
            let _ = host.wait();
        }
        let peak = (before + peak()?) / 2.0;
        let error = String::from_utf8_lossy(&output.stderr);
        ensure!(output.status.success(), "{} failed: {error}", workload.name);
        let result: Value = serde_json::from_slice(&output.stdout).context("parse the run's JSON output")?;
        let rate = result["fps"]["env_steps_per_s"].as_f64().context("the run's JSON has no speed")?;
        let chosen = result["run"]["environment"]["env_choice"]["envs"].as_u64();
        Ok(TunedRun { env_steps_per_s: rate, peak, chosen, rows: rows(&db)? })
    }

    fn start_host(&self, workload: &Workload, name: &str) -> Result<Option<Child>> {
        let (Some(arguments), Some(python)) = (workload.host, self.python) else { return Ok(None) };
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/peers/slow_host.py");
        let mut command = Command::new(python);
        command.arg(script).arg(name).args(arguments).stdin(Stdio::null()).stdout(Stdio::null());
        Ok(Some(command.spawn().with_context(|| format!("start {}", python.display()))?))
    }
}

/// Measures the register peak of all cores, in GFLOP/s.
fn peak() -> Result<f64> {
    Ok(peak_gflop_per_s(std::thread::available_parallelism()?.get()))
}

/// Returns the rows of a results file: what was run, and the fingerprint of the trajectory.
fn rows(db: &Path) -> Result<Vec<String>> {
    let file = Connection::open(db)?;
    let row = "policy || ' ' || task || ' ' || perturbation || ' ' || episode || ' ' || fingerprint";
    let mut statement = file.prepare(&format!("SELECT {row} FROM episodes ORDER BY 1"))?;
    let rows = statement.query_map([], |row| row.get(0))?;
    Ok(rows.collect::<Result<_, _>>()?)
}
