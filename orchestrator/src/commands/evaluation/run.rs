//! `hypogeum run`: evaluates policies, stores the results and reports them.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use clap::Args;
use policy_host::PolicySpec;
use policy_host::nn::Precision;
use run_config::{Protocol, trace};
use serde_json::{Value, json};

use crate::console::exit::{ExitStatus, Failure, OrUser};
use crate::console::interrupt;
use crate::console::output::{OutputError, print_message, print_out};
use crate::console::progress::Progress;
use crate::fleet::RunStatus;
use crate::plan::RunPlan;
use crate::plan::partition::ShardPart;
use crate::plan::sweep::SweepArgs;
use crate::run::execution::{execute, find_device, resolve};
use crate::run::live::{LiveView, RunningSuccess};
use crate::run::observer::RunObserver;
use crate::run::recorder::Recorder;
use crate::run::sharding::ShardArgs;
use crate::run::stopping::{SequentialCell, Stopping};
use crate::run::trace_file::TraceFile;
use crate::selection::policy::{Identity, NamedPolicy};
use crate::store::results::{Manifest, Results};
use crate::store::shards::ShardTask;
use crate::study::machine::{Cores, Machine};
use crate::study::report::{self, Fps};

/// Arguments of `run`.
#[derive(Debug, Args)]
pub(crate) struct RunArgs {
    /// Sweep file: the options below as TOML keys, for example `control_mode` for --control-mode and the list
    /// `policies` for --policy. Options on the command line override those of the file
    #[arg(value_name = "SWEEP.toml")]
    pub(crate) file: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) sweep: SweepArgs,
    #[command(flatten)]
    pub(crate) sharding: ShardArgs,
    /// Print one JSON object instead of a table
    #[arg(long)]
    pub(crate) json: bool,
    /// Also print where the time went: the ledger, the bound, and how the number of envs was chosen
    #[arg(long)]
    pub(crate) verbose: bool,
    /// Show no progress
    #[arg(long)]
    pub(crate) quiet: bool,
    /// End in order, like after SIGTERM, when the standard input ends
    #[arg(long, hide = true)]
    pub(crate) end_with_stdin: bool,
    #[arg(skip = Instant::now())]
    started: Instant,
}

/// Runs the episodes that the results file does not have yet, and reports the results of the whole plan.
pub(crate) fn run(args: &RunArgs) -> Result<ExitStatus, Failure> {
    if args.end_with_stdin {
        interrupt::terminate_at_end_of_input().context("failed to watch the standard input")?;
    }
    let mut plan = RunPlan::new(&args.sweep).or_user()?;
    let device = find_device(&plan.policies, &mut plan.config)?;
    let identities = resolve(&mut plan, device.as_deref())?;
    let manifest = Manifest::new(&plan, identities.clone());
    print_notes(&plan, &manifest);
    match args.sharding.enter(&mut plan, &manifest)? {
        None => evaluate(args, &plan, &manifest, &identities, None),
        Some((task, part)) => {
            let ended = evaluate(args, &plan, &manifest, &identities, Some((&task, &part)));
            task.finish(ended)
        }
    }
}

/// Runs the episodes of a plan, or of a shard of it.
fn evaluate(
    args: &RunArgs,
    plan: &RunPlan,
    manifest: &Manifest,
    identities: &[Identity],
    shard: Option<(&ShardTask, &ShardPart)>,
) -> Result<ExitStatus, Failure> {
    let machine = Machine::detect();
    let part = shard.map(|(_, part)| part);
    let (recorder, todo) = Recorder::open(plan, manifest, args.started, part)?;
    let progress = Progress::of_run(recorder.n_planned(), recorder.n_done(), args.quiet, args.json);
    let mut observer = RunObserver {
        stopping: recorder.stopping()?,
        live: LiveView::new(progress, RunningSuccess::new(plan, recorder.results()).or_user()?),
        trace: open_trace(plan.config.resources.trace.as_deref()).or_user()?,
        recorder,
        shard: shard.map(|(task, _)| task),
    };
    let renderer = observer.recorder.renderer()?;
    let outcome = execute(plan, identities, todo, renderer.as_deref(), &mut observer);
    let RunObserver { recorder, stopping, live, trace, .. } = observer;
    live.finish();
    recorder.check()?;
    let traced = trace.map_or(Ok(()), TraceFile::finish);
    if outcome.is_err() {
        recorder.on_failure();
    }
    let (status, totals) = outcome?;
    let environment = recorder.note_environment(&machine, &totals)?;
    if status == RunStatus::Stopped {
        print_message(&format!("interrupted; {}", recorder.resume_hint()));
        return Ok(ExitStatus::Interrupted);
    }
    let n_threads = plan.config.resources.n_threads();
    let cores = Cores::measure(&machine, n_threads, totals.hosts().flop > 0);
    let fps = Fps::new(&totals, args.started.elapsed(), cores);
    let conclusions = stopping.as_ref().map_or_else(Vec::new, Stopping::conclusions);
    let mut run = json!(manifest);
    run["environment"] = environment;
    let shown = (args.verbose, args.json.then_some(&run));
    let status = print_results(plan, recorder.results(), &conclusions, &fps, shown, part.is_some())?;
    traced.or_user()?;
    Ok(status)
}

fn print_notes(plan: &RunPlan, manifest: &Manifest) {
    if manifest.options.protocol != Protocol::default() {
        print_message(&manifest.options.protocol.to_string());
    }
    for (name, identity) in &manifest.policies {
        identity.notes.iter().for_each(|note| print_message(&format!("policy `{name}`: {note}")));
    }
    for NamedPolicy { name, spec } in &plan.policies {
        let is_int8 = matches!(spec, PolicySpec::Network(_, source) if source.precision == Precision::Int8);
        if is_int8 && !Machine::detect().is_fast_in_int8() {
            print_message(&format!(
                "policy `{name}`: 8-bit inference is slower than f32 on this processor, which lacks AVX-512 VNNI"
            ));
        }
    }
}

/// Prints the results of the whole plan: as JSON with the description `run`, or for people without one, and
/// then with all lines on speed if `verbose`. The cells of a shard are parts of cells, which tell people
/// nothing.
fn print_results(
    plan: &RunPlan,
    results: &Results,
    conclusions: &[SequentialCell],
    fps: &Fps,
    (verbose, run): (bool, Option<&Value>),
    is_shard: bool,
) -> Result<ExitStatus, Failure> {
    let cells = report::cells(plan, results).or_user()?;
    if let Some(run) = run {
        let mut report = report::json(run, &cells, plan.stopped(), fps);
        if let Some(rule) = &plan.stopping {
            report["stopping"] = report::stopping::json(rule, conclusions);
        }
        print_out(&format!("{report:#}\n"))?;
    } else {
        let speed = if verbose { fps.lines() } else { fps.line() };
        if is_shard {
            print_out(&speed)?;
        } else {
            print_report(plan, &cells, conclusions, &speed)?;
        }
    }
    let errored = cells.iter().any(|cell| cell.sums.errors > 0);
    Ok(if errored { ExitStatus::EpisodeErrors } else { ExitStatus::Success })
}

/// Creates the trace file, if there is to be one, and starts recording in this process.
fn open_trace(path: Option<&Path>) -> anyhow::Result<Option<TraceFile>> {
    let file = path.map(TraceFile::create).transpose()?;
    if file.is_some() {
        trace::enable();
    }
    Ok(file)
}

fn print_report(
    plan: &RunPlan,
    cells: &[report::Cell],
    conclusions: &[SequentialCell],
    speed: &str,
) -> Result<(), OutputError> {
    let table = report::table(plan, cells, conclusions);
    let gap = if speed.is_empty() { "" } else { "\n" };
    print_out(&format!("{table}{gap}{speed}"))
}
